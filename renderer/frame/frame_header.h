// Facts of a frame that are known before it is rendered. Called by the runner, and by who writes
// about frames while they are rendered.
#pragma once

#include "renderer/frame/frame.h"
#include "renderer/frame/image_camera.h"

namespace heliograph {

/// The image of a job's camera in the middle of what its labels are taken of.
///
/// camera   index over the job's cameras
[[nodiscard]] ImageCamera image_of(const RenderJob& job, u32 camera);

/// The frame of a job's camera without what rendering finds: pixels, labels, samples, noise.
[[nodiscard]] Frame frame_header(const RenderJob& job, u32 camera);

}  // namespace heliograph
