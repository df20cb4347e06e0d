// Slots in their places. Called by the resident placement, and by the GPU's program that makes
// instances: both get the same bytes where products and sums are not contracted.
#pragma once

#include "kernels/core/finite.h"
#include "kernels/geometry/motion.h"
#include "kernels/scene/ray.h"

namespace heliograph::kernels::inline HELIO_ISA {

KERNEL mat4x3 scaled(const mat4x3& m, vec3 scale) {
  return mat4x3(m[0] * scale.x, m[1] * scale.y, m[2] * scale.z, m[3]);
}

/// Inverse of an affine map, by way of double precision.
KERNEL mat4x3 exact_inverse(const mat4x3& m) {
  const glm::dmat3 linear = glm::inverse(glm::dmat3(mat3(m[0], m[1], m[2])));
  return mat4x3(vec3(linear[0]), vec3(linear[1]), vec3(linear[2]),
                vec3(-(linear * glm::dvec3(m[3]))));
}

/// True if an instance can be shown with this matrix: it has an inverse.
KERNEL bool usable_pose(const mat4x3& m) {
  const float det = glm::determinant(mat3(m[0], m[1], m[2]));
  return is_finite(det) && det != 0 && is_finite(m[3].x + m[3].y + m[3].z);
}
KERNEL bool usable_key(const MotionKey& key) {
  const float det = key.xx * key.yy * key.zz;
  return is_finite(det) && det != 0 &&
         is_finite(key.translation.x + key.translation.y + key.translation.z);
}

/// True if rays that begin within kReach are nowhere farther than kFarthest in an object's frame.
KERNEL bool is_within_reach(const mat4x3& object_from_world) {
  for (int row = 0; row < 3; ++row) {
    float most = glm::abs(object_from_world[3][row]);
    for (int axis = 0; axis < 3; ++axis) most += glm::abs(object_from_world[axis][row]) * kReach;
    if (!(most < kFarthest)) return false;
  }
  return true;
}

/// True if a slot can be shown.
///
/// world   takes the coordinates of its mesh to the world
KERNEL bool is_usable(const SlotView& slot, const mat4x3& world, const MotionKey* motion_keys) {
  bool usable = usable_pose(world);
  for (u32 i = 0; usable && slot.segments > 0 && i <= slot.segments; ++i)
    usable = usable_key(motion_keys[slot.first_key + i]);
  return usable;
}
KERNEL bool are_within_reach(const SlotView& slot, const MotionKey* motion_keys) {
  for (u32 i = 0; i <= slot.segments; ++i) {
    const MotionKey& key = motion_keys[slot.first_key + i];
    if (!is_within_reach(inverse_of(interpolate(key, key, 0)))) return false;
  }
  return true;
}

/// The instance of a slot. What cannot be shown has the identity.
KERNEL InstanceView placed(const SlotView& slot, const mat4x3& world_from_entity,
                           const MotionKey* motion_keys) {
  const mat4x3 world = scaled(world_from_entity, slot.scale);
  const bool usable = is_usable(slot, world, motion_keys);
  InstanceView instance{slot, usable ? world : mat4x3(1),
                        usable ? exact_inverse(world) : mat4x3(1)};
  const bool within_reach = slot.segments == 0 ? is_within_reach(instance.object_from_world)
                                               : are_within_reach(slot, motion_keys);
  if (!usable || !within_reach) instance.visibility = 0;
  const mat4x3& shown = instance.world_from_object;
  if (glm::determinant(mat3(shown[0], shown[1], shown[2])) < 0) instance.flags |= kFlipped;
  return instance;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
