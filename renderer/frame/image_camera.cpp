#include "renderer/frame/image_camera.h"

#include <algorithm>
#include <limits>
#include <numbers>

#include "kernels/camera/projection.h"
#include "renderer/scene/ray_table.h"

namespace heliograph {

namespace {
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

glm::dmat4 cv_from_gl() {
  glm::dmat4 m(1);
  m[1][1] = m[2][2] = -1;
  return m;
}

mat4x3 affine(const glm::dmat4& m) { return {vec3(m[0]), vec3(m[1]), vec3(m[2]), vec3(m[3])}; }

kernels::LensModel<float> single(const kernels::LensModel<double>& lens) {
  kernels::LensModel<float> out{.projection = lens.projection, .distorted = lens.distorted};
  std::ranges::transform(lens.k, out.k, [](double k) { return float(k); });
  out.limit = float(lens.limit);
  return out;
}

kernels::LensModel<double> lens_of(const Camera& camera) {
  kernels::LensModel<double> lens{.projection = camera.projection};
  std::ranges::copy(camera.distortion, lens.k);
  lens.distorted = std::ranges::any_of(camera.distortion, [](double k) { return k != 0; });
  lens.limit = kernels::lens_limit(lens);
  return lens;
}

kernels::ApertureView aperture_of(const Camera& camera) {
  return {.radius = float(camera.aperture / 2),
          .focus = float(camera.focus_distance),
          .blades = camera.blades,
          .turn = float(camera.blade_rotation / (2 * std::numbers::pi))};
}
}  // namespace

glm::dmat4 rigid_camera(const mat4x3& world_from_camera) {
  const auto axis = [&](int i) { return glm::dvec3(world_from_camera[i]); };
  const glm::dvec3 back = glm::normalize(axis(2));
  const glm::dvec3 up = glm::normalize(axis(1) - back * glm::dot(back, axis(1)));
  return {glm::dvec4(glm::cross(up, back), 0), glm::dvec4(up, 0), glm::dvec4(back, 0),
          glm::dvec4(axis(3), 1)};
}

ImageCamera image_camera(const Camera& camera, const mat4x3& world_from_camera, u32 width,
                         u32 height) {
  const double sx = double(width) / camera.width, sy = double(height) / camera.height;
  ImageCamera out{.lens = lens_of(camera),
                  .rays = camera.rays,
                  .aperture = aperture_of(camera),
                  .near = camera.near,
                  .far = camera.far,
                  .width = width,
                  .height = height};
  out.k = glm::dmat3(0);
  out.k[0][0] = camera.fx * sx;
  out.k[1][1] = camera.fy * sy;
  out.k[2] = {camera.cx * sx + 0.5 * (sx - 1), camera.cy * sy + 0.5 * (sy - 1), 1};
  out.camera_from_world_cv = cv_from_gl() * glm::inverse(rigid_camera(world_from_camera));
  return out;
}

bool direction_of(const ImageCamera& camera, u32 x, u32 y, glm::dvec3& direction) {
  if (camera.rays) {
    direction = glm::dvec3(camera.rays->rays[u64(y) * camera.width + x].direction);
    return direction != glm::dvec3(0);
  }
  const glm::dvec2 m((x - camera.k[2][0]) / camera.k[0][0], (y - camera.k[2][1]) / camera.k[1][1]);
  if (!kernels::unproject(camera.lens, m, direction)) return false;
  if (kernels::is_parallel(camera.lens.projection)) direction = glm::dvec3(0, 0, 1);
  return true;
}

glm::dvec2 project(const ImageCamera& camera, const glm::dvec3& p_camera) {
  glm::dvec2 m;
  if (!kernels::project(camera.lens, p_camera, m)) return {kNaN, kNaN};
  return {camera.k[0][0] * m.x + camera.k[2][0], camera.k[1][1] * m.y + camera.k[2][1]};
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
  view.lens = single(camera.lens);
  if (camera.rays) view.table = camera.rays->view;
  view.aperture = camera.aperture;
  view.near = float(camera.near);
  view.far = float(camera.far);
  return view;
}

}  // namespace heliograph
