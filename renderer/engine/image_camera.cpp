#include "renderer/engine/image_camera.h"

#include <limits>

namespace heliograph {

namespace {
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

glm::dmat4 cv_from_gl() {
  glm::dmat4 m(1);
  m[1][1] = m[2][2] = -1;
  return m;
}

mat4x3 affine(const glm::dmat4& m) { return {vec3(m[0]), vec3(m[1]), vec3(m[2]), vec3(m[3])}; }
}  // namespace

ImageCamera image_camera(const Camera& camera, const mat4x3& world_from_camera, u32 width,
                         u32 height) {
  const double sx = double(width) / camera.width, sy = double(height) / camera.height;
  ImageCamera out{.projection = camera.projection, .width = width, .height = height};
  out.k = glm::dmat3(0);
  out.k[0][0] = camera.fx * sx;
  out.k[1][1] = camera.fy * sy;
  out.k[2] = {(camera.cx + 0.5) * sx - 0.5, (camera.cy + 0.5) * sy - 0.5, 1};
  glm::dmat4 world(1);
  for (int i = 0; i < 3; ++i)
    world[i] = glm::dvec4(glm::normalize(glm::dvec3(world_from_camera[i])), 0);
  world[3] = glm::dvec4(glm::dvec3(world_from_camera[3]), 1);
  out.camera_from_world_cv = cv_from_gl() * glm::inverse(world);
  return out;
}

glm::dvec2 project(const ImageCamera& camera, const glm::dvec3& p_camera) {
  if (!(p_camera.z > 0)) return {kNaN, kNaN};
  const double z = camera.projection == Projection::kPerspective ? p_camera.z : 1;
  return {camera.k[0][0] * p_camera.x / z + camera.k[2][0],
          camera.k[1][1] * p_camera.y / z + camera.k[2][1]};
}

kernels::CameraView camera_view(const ImageCamera& camera) {
  const glm::dmat4 camera_from_world = cv_from_gl() * camera.camera_from_world_cv;
  kernels::CameraView view{};
  view.world_from_camera = affine(glm::inverse(camera_from_world));
  view.camera_from_world = affine(camera_from_world);
  view.fx = float(camera.k[0][0]);
  view.fy = float(camera.k[1][1]);
  view.cx = float(camera.k[2][0] + 0.5);
  view.cy = float(camera.k[2][1] + 0.5);
  view.width = camera.width;
  view.height = camera.height;
  view.projection = camera.projection == Projection::kPerspective
                        ? kernels::Projection::kPerspective
                        : kernels::Projection::kOrthographic;
  return view;
}

}  // namespace heliograph
