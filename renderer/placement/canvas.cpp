#include "renderer/placement/canvas.h"

#include <numbers>

#include "kernels/camera/camera.h"
#include "kernels/geometry/motion.h"

namespace heliograph::resident {
namespace {

/// Raster positions, with a pixel to spare on each side.
struct Extent {
  vec2 low{INFINITY}, high{-INFINITY};

  void add(vec2 raster) {
    low = glm::min(low, raster);
    high = glm::max(high, raster);
  }
  [[nodiscard]] PixelBox within(const PixelBox& canvas) const {
    const auto clip = [](float v, i32 from, i32 to) {
      return i32(std::clamp(v, float(from), float(to)));
    };
    const PixelBox box{clip(std::floor(low.x) - 1, canvas.x0, canvas.x1),
                       clip(std::floor(low.y) - 1, canvas.y0, canvas.y1),
                       clip(std::ceil(high.x) + 1, canvas.x0, canvas.x1),
                       clip(std::ceil(high.y) + 1, canvas.y0, canvas.y1)};
    return box.x0 < box.x1 && box.y0 < box.y1 ? box : PixelBox{};
  }
};

using Corners = std::array<vec3, 8>;  // OpenCV camera frame

PixelBox straight_bounds(const Corners& corners, const kernels::CameraView& camera,
                         const PixelBox& canvas) {
  Extent extent;
  u32 behind = 0;
  for (const vec3& corner : corners) {
    const kernels::Projected p = kernels::project_cv(camera, corner);
    behind += !p.seen;
    extent.add(p.raster);
  }
  if (behind == 8) return {};
  if (behind > 0) return canvas;
  return extent.within(canvas);
}

/// Directions within an angle below 90 degrees of an axis: a convex set, so that one that holds a
/// box's corners holds the box.
struct Cone {
  vec3 axis{0};
  float cosine = -1;
};

Cone cone_of(const Corners& corners) {
  Cone cone;
  for (const vec3& corner : corners) cone.axis += kernels::normalize_or(corner, vec3(0));
  cone.axis = kernels::normalize_or(cone.axis, vec3(0));
  cone.cosine = 1;
  for (const vec3& corner : corners)
    cone.cosine =
        std::min(cone.cosine, glm::dot(cone.axis, kernels::normalize_or(corner, vec3(0))) - 1e-6f);
  return cone;
}

/// The cone in longitude and latitude; rows alone where it crosses the seam.
PixelBox panorama_bounds(const Cone& cone, const kernels::CameraView& camera,
                         const PixelBox& canvas) {
  constexpr float kHalfTurn = std::numbers::pi_v<float>;
  const float half = std::acos(cone.cosine), latitude = std::asin(cone.axis.y);
  if (std::fabs(latitude) + half > 0.5f * kHalfTurn - 1e-3f) return canvas;
  const float longitude = std::atan2(cone.axis.x, cone.axis.z);
  const float wide = std::asin(std::sin(half) / std::cos(latitude)) + 1e-5f;
  const bool whole = std::fabs(longitude) + wide > kHalfTurn;
  const auto raster = [&](float x, float y) {
    return vec2(camera.fx * x + camera.cx, camera.fy * y + camera.cy);
  };
  Extent extent;
  extent.add(raster(whole ? -kHalfTurn : longitude - wide, latitude - half));
  extent.add(raster(whole ? kHalfTurn : longitude + wide, latitude + half));
  return extent.within(canvas);
}

/// Bounds of what a lens makes of the cone's rim, which bounds what it makes of the cone: it is
/// continuous there and meets no place twice. Between the rim's samples it strays from their box by
/// less than the margin.
PixelBox curved_bounds(const Cone& cone, const kernels::CameraView& camera,
                       const PixelBox& canvas) {
  constexpr int kSamples = 64;
  constexpr float kMargin = 0.02f;
  if (-cone.axis.z >= cone.cosine) return canvas;  // it surrounds what no lens sees
  const kernels::Frame frame = kernels::make_frame(cone.axis);
  const float sine = std::sqrt(1 - cone.cosine * cone.cosine);
  Extent extent;
  for (int i = 0; i < kSamples; ++i) {
    const float angle = 2 * std::numbers::pi_v<float> * float(i) / kSamples;
    const vec3 d =
        kernels::to_world(frame, vec3(std::cos(angle) * sine, std::sin(angle) * sine, cone.cosine));
    const kernels::Projected p = kernels::project_cv(camera, d);
    if (!p.seen) return canvas;
    extent.add(p.raster);
  }
  const vec2 margin = (extent.high - extent.low) * kMargin + 1.0f;
  extent.low -= margin;
  extent.high += margin;
  return extent.within(canvas);
}

/// Bounds of what lies between corners in the world, seen by a camera that stands still.
PixelBox bounds_at(const std::array<vec3, 8>& corners_world, const kernels::CameraView& camera,
                   const PixelBox& canvas) {
  Corners corners;
  for (u32 i = 0; i < 8; ++i) corners[i] = kernels::point_in_camera(camera, corners_world[i]);
  if (camera.table.rays) return canvas;
  if (kernels::is_rectilinear(camera.lens)) return straight_bounds(corners, camera, canvas);
  const Cone cone = cone_of(corners);
  if (!(cone.cosine > 0.02f)) return canvas;
  return kernels::wraps(camera.lens.projection) ? panorama_bounds(cone, camera, canvas)
                                                : curved_bounds(cone, camera, canvas);
}

bool is_empty(const PixelBox& box) { return box.x1 == box.x0; }

/// Bounds over a motion from boxes at steps so short that in between nothing goes beyond two
/// neighbours by more than they differ.
PixelBox sweep(const std::vector<PixelBox>& steps, const PixelBox& canvas) {
  PixelBox all = steps[0];
  i32 x = 0, y = 0;
  for (std::size_t i = 1; i < steps.size(); ++i) {
    const PixelBox &a = steps[i - 1], &b = steps[i];
    if (is_empty(a) != is_empty(b)) return canvas;  // it comes or goes
    x = std::max({x, std::abs(a.x0 - b.x0), std::abs(a.x1 - b.x1)});
    y = std::max({y, std::abs(a.y0 - b.y0), std::abs(a.y1 - b.y1)});
    all = {std::min(all.x0, b.x0), std::min(all.y0, b.y0), std::max(all.x1, b.x1),
           std::max(all.y1, b.y1)};
  }
  if (is_empty(all)) return all;
  return {std::max(all.x0 - x, canvas.x0), std::max(all.y0 - y, canvas.y0),
          std::min(all.x1 + x, canvas.x1), std::min(all.y1 + y, canvas.y1)};
}

}  // namespace

PixelBox canvas_of(const kernels::CameraView& camera, float extend) {
  if (kernels::wraps(camera.lens.projection) || camera.table.rays) extend = 0;
  const auto x = i32(std::lround(extend * float(camera.width)));
  const auto y = i32(std::lround(extend * float(camera.height)));
  return {-x, -y, i32(camera.width) + x, i32(camera.height) + y};
}

PixelBox bounds_on_canvas(const Placement& placement, u32 slot, const kernels::CameraView& camera,
                          const PixelBox& canvas) {
  const Box bounds = placement.mesh(slot).accelerator->bounds();
  if (bounds.empty()) return {};
  const kernels::InstanceView& instance = placement.instances()[slot];
  kernels::SceneView motion{};
  motion.motion_keys = placement.motion_keys.data();
  const u32 steps = 4 * std::max(instance.segments, camera.segments);
  std::vector<PixelBox> boxes;
  for (u32 step = 0; step <= steps; ++step) {
    const float time = steps > 0 ? float(step) / float(steps) : 0;
    const mat4x3 world = kernels::pose_at(motion, instance, time).world_from_object;
    std::array<vec3, 8> corners;
    for (u32 i = 0; i < 8; ++i) {
      const vec3 corner(i & 1 ? bounds.upper.x : bounds.lower.x,
                        i & 2 ? bounds.upper.y : bounds.lower.y,
                        i & 4 ? bounds.upper.z : bounds.lower.z);
      corners[i] = world * vec4(corner, 1);
    }
    const kernels::CameraAt now(camera, time);
    boxes.push_back(bounds_at(corners, now.camera(), canvas));
  }
  return sweep(boxes, canvas);
}

PixelBox bounds_on_canvas(const std::array<vec3, 8>& corners_world,
                          const kernels::CameraView& camera, const PixelBox& canvas) {
  const u32 steps = 4 * camera.segments;
  std::vector<PixelBox> boxes;
  for (u32 step = 0; step <= steps; ++step) {
    const kernels::CameraAt now(camera, steps > 0 ? float(step) / float(steps) : 0);
    boxes.push_back(bounds_at(corners_world, now.camera(), canvas));
  }
  return sweep(boxes, canvas);
}

}  // namespace heliograph::resident
