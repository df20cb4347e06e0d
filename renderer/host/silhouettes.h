// Instances alone, whatever hides them: amodal masks, counts and boxes; and what hides keypoints.
#pragma once

#include <vector>

#include "renderer/frame/label_columns.h"
#include "renderer/host/tracer.h"

namespace heliograph::host {

struct SilhouetteInputs {
  const kernels::CameraView& camera;
  const LabelOptions& options;
  std::span<const u32> instance_plane;    // width * height labels
  std::span<const float> distance_plane;  // the same pixels; empty: what is in front counts, too
};

/// Traces every labelled instance over its bounds on the canvas, one ray through each pixel's
/// centre. Within the image a pixel is of an instance that it shows, and of those behind what it
/// shows: an instance that nothing hides has no other pixel, however its edge is rounded. The
/// result has one entry for each row of the labelling. Partial when the interrupt was requested.
[[nodiscard]] std::vector<Silhouette> trace_silhouettes(const SceneRays& scene,
                                                        const SilhouetteInputs& in,
                                                        const Interrupt& interrupt);

/// The keypoints of every labelled instance, ordered by row. A keypoint is visible when the segment
/// from the camera to it meets no surface but within the keypoint radius of it.
[[nodiscard]] std::vector<KeypointLabel> trace_keypoints(const SceneRays& scene,
                                                         const kernels::CameraView& view,
                                                         const ImageCamera& camera,
                                                         const LabelOptions& options);

}  // namespace heliograph::host
