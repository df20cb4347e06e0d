// Boxes and cones of lights that move.
#include "renderer/lights/light_bounds.h"

#include <cmath>
#include <cstddef>
#include <cstring>

#include "kernels/geometry/motion.h"
#include "renderer/lights/light_strength.h"
#include "renderer/placement/mesh.h"
#include "renderer/scene/light_shapes.h"

namespace heliograph::resident {
namespace {

/// At the pose of the middle.
kernels::LightBounds bounds_at_rest(const kernels::LightBounds& bounds,
                                    const kernels::InstanceView& instance) {
  const mat4x3& m = instance.world_from_object;
  const vec3 center = kernels::transform_point(m, 0.5f * (bounds.lower + bounds.upper));
  const vec3 half = 0.5f * (bounds.upper - bounds.lower);
  const vec3 extent = glm::abs(m[0]) * half.x + glm::abs(m[1]) * half.y + glm::abs(m[2]) * half.z;
  kernels::LightBounds world = bounds;
  world.lower = center - extent;
  world.upper = center + extent;
  world.axis = kernels::normalize_or(
      kernels::transform_normal(instance.object_from_world, bounds.axis), vec3(0, 0, 1));
  // Only similar maps keep the angles of a cone; a single normal has none.
  if (bounds.cos_spread < 1 && !area_scale(m)) world.cos_spread = -1;
  return world;
}

/// True if two keys differ in their translation alone.
bool same_directions(const kernels::MotionKey& a, const kernels::MotionKey& b) {
  return a.rotation == b.rotation &&
         std::memcmp(&a.xx, &b.xx, sizeof a - offsetof(kernels::MotionKey, xx)) == 0;
}

/// Widens the bounds at rest to the whole motion of an instance.
///
/// Between two keys p goes to T + R S p, where T and S go linearly and R along an arc, which leaves
/// its chord by the sagitta |S p| (1 - cos(angle / 2)).
void add_motion(kernels::LightBounds& world, const kernels::LightBounds& bounds,
                std::span<const kernels::MotionKey> keys) {
  const vec3 center = 0.5f * (bounds.lower + bounds.upper);
  const vec3 half = 0.5f * (bounds.upper - bounds.lower);
  for (std::size_t i = 0; i + 1 < keys.size(); ++i) {
    const float sagitta =
        1 - std::min(std::abs(glm::dot(keys[i].rotation, keys[i + 1].rotation)), 1.0f);
    Box turned;
    for (const auto& rotation : {keys[i].rotation, keys[i + 1].rotation})
      for (const auto* s : {&keys[i], &keys[i + 1]}) {
        const float shear[6] = {s->xx, s->xy, s->xz, s->yy, s->yz, s->zz};
        const mat4x3 m = kernels::matrix_of(vec3(0), rotation, shear);
        const vec3 at = m * vec4(center, 1);
        vec3 extent = glm::abs(m[0]) * half.x + glm::abs(m[1]) * half.y + glm::abs(m[2]) * half.z;
        extent += vec3((glm::length(at) + glm::length(extent)) * sagitta);
        turned.extend(at - extent);
        turned.extend(at + extent);
      }
    for (const auto& key : {keys[i], keys[i + 1]}) {
      world.lower = glm::min(world.lower, key.translation + turned.lower);
      world.upper = glm::max(world.upper, key.translation + turned.upper);
    }
    if (!same_directions(keys[i], keys[i + 1])) world.cos_spread = -1;
  }
}

}  // namespace

kernels::LightBounds world_bounds(const kernels::LightBounds& bounds,
                                  const kernels::InstanceView& instance,
                                  std::span<const kernels::MotionKey> keys) {
  kernels::LightBounds world = bounds_at_rest(bounds, instance);
  add_motion(world, bounds, keys);
  return world;
}

}  // namespace heliograph::resident
