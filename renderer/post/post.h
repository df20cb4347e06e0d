// Makes the planes that are computed from other planes of their frame. Called by the runner.
#pragma once

#include "renderer/frame/film_planes.h"
#include "renderer/frame/image_camera.h"
#include "renderer/post/denoiser.h"

namespace heliograph {

struct PostContext {
  Denoiser& denoiser;
  const Interrupt& interrupt;
  const Camera& model;  // whose sensors the job asks for
  const ImageCamera& camera;
  u64 sensor_seed;
};
/// Seed of the noise of a camera's sensors: another one for each name.
[[nodiscard]] u64 sensor_seed(const RenderJob& job, EntityId camera);

/// A job's planes in its order, from those that the backend made (Backend::resolve). Post planes
/// that it left out are made here, in the host's memory.
[[nodiscard]] Expected<std::vector<PlaneData>> finish_planes(const RenderJob& job,
                                                             std::vector<PlaneData> made,
                                                             const PostContext& context);

}  // namespace heliograph
