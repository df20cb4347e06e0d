// Planes that are computed from other planes of their frame. Called by checks, films and the
// runner.
#pragma once

#include "renderer/engine/denoiser.h"
#include "renderer/engine/image_camera.h"

namespace heliograph {

/// The planes that a backend makes for a job: those it asks for that are no post planes, in its
/// order, then what the post planes are computed from.
/// Whether a job asks for planes that are made of others.
[[nodiscard]] bool wants_post(const RenderJob& job);
[[nodiscard]] std::vector<Plane> film_planes(const RenderJob& job);

/// Whether anybody but DENOISED reads a plane of film_planes(): the job's reader, or another post
/// plane.
[[nodiscard]] bool is_read_beside(const RenderJob& job, Plane film_plane);

struct PostContext {
  Denoiser& denoiser;
  const Interrupt& interrupt;
  const Camera& model;  // whose sensors the job asks for
  const ImageCamera& camera;
  u64 sensor_seed;
};
/// Of the noise of a camera's sensors: another one for each name.
[[nodiscard]] u64 sensor_seed(const RenderJob& job, EntityId camera);

/// A job's planes in its order, from those that the backend made (Backend::resolve). Post planes
/// that it left out are made here, in the host's memory.
[[nodiscard]] Expected<std::vector<PlaneData>> finish_planes(const RenderJob& job,
                                                             std::vector<PlaneData> made,
                                                             const PostContext& context);

}  // namespace heliograph
