#include "renderer/bvh/instance_box.h"

#include <algorithm>
#include <array>

#include "kernels/motion.h"

namespace heliograph::bvh {
namespace {

using kernels::MotionKey;

constexpr float kStepTurn = 0.1f;  // radians between poses that are looked at
constexpr u32 kMostSteps = 64;

std::array<vec3, 8> corners(const Box& box) {
  std::array<vec3, 8> out;
  for (u32 i = 0; i < 8; ++i)
    out[i] = {i & 1 ? box.upper.x : box.lower.x, i & 2 ? box.upper.y : box.lower.y,
              i & 4 ? box.upper.z : box.lower.z};
  return out;
}

vec3 sheared(const MotionKey& key, vec3 p) {
  return {key.xx * p.x + key.xy * p.y + key.xz * p.z, key.yy * p.y + key.yz * p.z, key.zz * p.z};
}

float angle_between(vec4 a, vec4 b) {
  return 2 * std::acos(std::min(1.0f, std::abs(glm::dot(a, b))));
}

/// How far a point leaves the chord between two poses that are a step of 1 / steps apart: with x(u)
/// = T(u) + R(u) S(u) p, where T and S are linear and R turns at the rate w, |x''| <= w^2 |S p| +
/// 2 w |S' p|, and a chord is left by at most |x''| / (8 steps^2).
float sagitta(const MotionKey& a, const MotionKey& b, vec3 p, u32 steps) {
  const float rate = angle_between(a.rotation, b.rotation);
  const vec3 from = sheared(a, p), to = sheared(b, p);
  const float radius = std::max(glm::length(from), glm::length(to));
  const float bend = rate * (rate * radius + 2 * glm::length(to - from));
  // Rotations are known to about 1e-6, see kernels::interpolate_rotation().
  return bend / (8 * float(steps) * float(steps)) + 4e-6f * radius;
}

}  // namespace

Box placed_box(const Box& object, const mat4x3& world_from_object) {
  Box box;
  if (object.empty()) return box;
  for (const vec3& corner : corners(object)) box.extend(world_from_object * vec4(corner, 1));
  return box;
}

Box moving_box(const Box& object, std::span<const MotionKey> keys) {
  Box box;
  if (object.empty()) return box;
  const auto points = corners(object);
  for (std::size_t i = 0; i + 1 < keys.size(); ++i) {
    const MotionKey &a = keys[i], &b = keys[i + 1];
    const float turn = angle_between(a.rotation, b.rotation);
    const u32 steps = std::clamp(u32(std::ceil(turn / kStepTurn)), 1u, kMostSteps);
    float margin = 0;
    for (const vec3& p : points) margin = std::max(margin, sagitta(a, b, p, steps));
    Box segment;
    for (u32 s = 0; s <= steps; ++s)
      segment.extend(placed_box(object, kernels::interpolate(a, b, float(s) / float(steps))));
    box.extend({segment.lower - margin, segment.upper + margin});
  }
  return box;
}

}  // namespace heliograph::bvh
