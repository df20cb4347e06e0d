// Rays of a camera, and where it sees a point. Called by path.h and probe.h.
#pragma once

#include "kernels/math.h"
#include "kernels/ray.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// The unbounded ray through a raster position (pixel (x, y) covers [x, x + 1) x [y, y + 1)).
KERNEL Ray camera_ray(const CameraView& camera, vec2 raster, HoleKey holes) {
  const vec2 k((raster.x - camera.cx) / camera.fx, (camera.cy - raster.y) / camera.fy);
  if (camera.projection == Projection::kOrthographic) {
    return {transform_point(camera.world_from_camera, vec3(k, 0)),
            normalize(-camera.world_from_camera[2]), INFINITY, camera.time, holes};
  }
  return {camera.world_from_camera[3],
          normalize(transform_vector(camera.world_from_camera, vec3(k, -1))), INFINITY, camera.time,
          holes};
}

/// Where a camera sees something.
struct Projected {
  vec2 raster;
  bool in_front;  // otherwise raster means nothing
};

KERNEL Projected project_cv(const CameraView& camera, vec3 p_cv) {
  const bool in_front = p_cv.z > 0;
  const float scale = camera.projection == Projection::kOrthographic ? 1 : 1 / p_cv.z;
  return {vec2(camera.fx * p_cv.x * scale + camera.cx, camera.fy * p_cv.y * scale + camera.cy),
          in_front};
}

/// From the camera's OpenGL frame to its OpenCV frame (x right, y down, z forward), and back.
KERNEL vec3 cv_from_gl(vec3 v) { return vec3(v.x, -v.y, -v.z); }

KERNEL Projected project(const CameraView& camera, vec3 p_world) {
  return project_cv(camera, cv_from_gl(transform_point(camera.camera_from_world, p_world)));
}

/// Where a point infinitely far along a direction is seen. An orthographic camera sees it only
/// straight ahead; there `otherwise` is returned.
KERNEL Projected project_direction(const CameraView& camera, vec3 direction, vec2 otherwise) {
  const vec3 d = cv_from_gl(transform_vector(camera.camera_from_world, direction));
  if (camera.projection == Projection::kPerspective) return project_cv(camera, d);
  return {otherwise, d.z > 0 && sqr(d.x) + sqr(d.y) < 1e-10f * sqr(d.z)};
}

/// The camera's ray that ends at a point in front of it.
KERNEL Ray camera_ray_to(const CameraView& camera, vec3 p_world, HoleKey holes) {
  vec3 direction;
  if (camera.projection == Projection::kOrthographic) {
    direction = normalize(-camera.world_from_camera[2]);
    const float distance = dot(p_world - camera.world_from_camera[3], direction);
    return {p_world - direction * distance, direction, distance, camera.time, holes};
  }
  direction = p_world - camera.world_from_camera[3];
  const float distance = length(direction);
  return {camera.world_from_camera[3], direction / distance, distance, camera.time, holes};
}

KERNEL bool inside_image(const CameraView& camera, vec2 raster) {
  return raster.x >= 0 && raster.y >= 0 && raster.x < float(camera.width) &&
         raster.y < float(camera.height);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
