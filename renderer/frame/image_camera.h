// A camera at the size it is rendered at: intrinsics and pose, in double and for kernels.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/base/types.h"
#include "renderer/scene/components.h"

namespace heliograph {

/// The camera a frame is seen by, in double precision.
struct ImageCamera {
  glm::dmat3 k{1};  // OpenCV intrinsics at the rendered size
  glm::dmat4 camera_from_world_cv{1};
  kernels::LensModel<double> lens{};
  std::shared_ptr<const RayTable> rays;  // of the projection kRayTable
  kernels::ApertureView aperture{};
  double near = 0, far = 0;
  u32 width = 0;
  u32 height = 0;
};
/// A camera's pose in the world without scale and shear: it looks where -z points, with y up.
[[nodiscard]] glm::dmat4 rigid_camera(const mat4x3& world_from_camera);
[[nodiscard]] ImageCamera image_camera(const Camera& camera, const mat4x3& world_from_camera,
                                       u32 width, u32 height);
/// Along what pixel (x, y) looks, in the OpenCV camera frame and of any length; false: along
/// nothing.
[[nodiscard]] bool direction_of(const ImageCamera& camera, u32 x, u32 y, glm::dvec3& direction);
/// K coordinates of a point in the OpenCV camera frame; NaN where the camera does not see it, or
/// does not know where, as one of a ray table.
[[nodiscard]] glm::dvec2 project(const ImageCamera& camera, const glm::dvec3& p_camera);
/// The same for kernels, whose cx and cy are raster coordinates.
[[nodiscard]] kernels::CameraView camera_view(const ImageCamera& camera);

}  // namespace heliograph
