// Boxes, and where an instance is at any time of its motion. Called by bvh_build.h, and by
// renderer/bvh for the trees that the host builds.
#pragma once

#include "kernels/bvh/bvh.h"
#include "kernels/geometry/primitive.h"

namespace heliograph::kernels::inline HELIO_ISA {

struct BvhBox {
  vec3 lower, upper;
  KERNEL void extend(vec3 p) {
    lower = glm::min(lower, p);
    upper = glm::max(upper, p);
  }
  KERNEL void extend(const BvhBox& box) {
    lower = glm::min(lower, box.lower);
    upper = glm::max(upper, box.upper);
  }
  [[nodiscard]] KERNEL bool empty() const { return !(lower.x <= upper.x); }
  [[nodiscard]] KERNEL vec3 center() const { return lower * 0.5f + upper * 0.5f; }
  [[nodiscard]] KERNEL vec3 corner(u32 i) const {
    return {i & 1 ? upper.x : lower.x, i & 2 ? upper.y : lower.y, i & 4 ? upper.z : lower.z};
  }
};

/// The empty box.
KERNEL BvhBox no_box() { return {vec3(INFINITY), vec3(-INFINITY)}; }

/// Half the surface area of a box scaled by `scale`.
KERNEL float box_area(const BvhBox& box, float scale) {
  const vec3 d = box.upper * scale - box.lower * scale;
  return d.x * d.y + d.y * d.z + d.z * d.x;
}

/// A box of the world about the box of an object.
KERNEL BvhBox placed_box(const BvhBox& object, const mat4x3& world_from_object) {
  BvhBox box = no_box();
  if (object.empty()) return box;
  for (u32 i = 0; i < 8; ++i) box.extend(world_from_object * vec4(object.corner(i), 1));
  return box;
}

KERNEL vec3 sheared(const MotionKey& key, vec3 p) {
  return {key.xx * p.x + key.xy * p.y + key.xz * p.z, key.yy * p.y + key.yz * p.z, key.zz * p.z};
}

KERNEL float angle_between(vec4 a, vec4 b) {
  return 2 * std::acos(min2(1.0f, std::fabs(dot(a, b))));
}

/// How far a point leaves the chord between two poses that are a step of 1 / steps apart: with x(u)
/// = T(u) + R(u) S(u) p, where T and S are linear and R turns at the rate w, |x''| <= w^2 |S p| +
/// 2 w |S' p|, and a chord is left by at most |x''| / (8 steps^2).
KERNEL float sagitta(const MotionKey& a, const MotionKey& b, vec3 p, u32 steps) {
  const float rate = angle_between(a.rotation, b.rotation);
  const vec3 from = sheared(a, p), to = sheared(b, p);
  const float radius = max2(length(from), length(to));
  const float bend = rate * (rate * radius + 2 * length(to - from));
  // Rotations are known to about 1e-6, see interpolate_rotation().
  return bend / (8 * float(steps) * float(steps)) + 4e-6f * radius;
}

/// The same as placed_box() while it moves along segments + 1 keys as interpolate() has it.
KERNEL BvhBox moving_box(const BvhBox& object, const MotionKey* keys, u32 segments) {
  constexpr float kStepTurn = 0.1f;  // radians between poses that are looked at
  constexpr float kMostSteps = 64;
  BvhBox box = no_box();
  if (object.empty()) return box;
  for (u32 i = 0; i < segments; ++i) {
    const MotionKey &a = keys[i], &b = keys[i + 1];
    const float turn = angle_between(a.rotation, b.rotation);
    const u32 steps = u32(min2(kMostSteps, max2(1.0f, std::ceil(turn / kStepTurn))));
    float margin = 0;
    for (u32 c = 0; c < 8; ++c) margin = max2(margin, sagitta(a, b, object.corner(c), steps));
    BvhBox segment = no_box();
    for (u32 s = 0; s <= steps; ++s)
      segment.extend(placed_box(object, interpolate(a, b, float(s) / float(steps))));
    box.extend(BvhBox{segment.lower - margin, segment.upper + margin});
  }
  return box;
}

/// Box of an instance at any time.
///
/// object   its mesh's box, at all times
KERNEL BvhBox instance_box(const InstanceView& instance, const MotionKey* motion_keys,
                           const BvhBox& object) {
  // Keys of what rays do not meet may have no pose.
  return instance.segments > 0 && instance.visibility
             ? moving_box(object, motion_keys + instance.first_key, instance.segments)
             : placed_box(object, instance.world_from_object);
}

/// Box where rays look for it; empty where none meets it. Rounding of a ray's way into an instance
/// moves its box by less than what this one is larger by.
KERNEL BvhBox ray_box(const InstanceView& instance, const MotionKey* motion_keys,
                      const BvhBox& object) {
  const BvhBox box = instance_box(instance, motion_keys, object);
  if (instance.visibility == 0 || box.empty()) return no_box();
  const vec3 margin = glm::max(glm::abs(box.lower), glm::abs(box.upper)) * 0x1p-21f;
  return {box.lower - margin, box.upper + margin};
}

/// Box of a primitive at any time.
KERNEL BvhBox primitive_box(const MeshView& mesh, u32 number) {
  BvhBox box = no_box();
  for (u32 key = 0; key <= mesh.segments; ++key) bound_primitive(mesh, number, key, box);
  return box;
}

/// True if the tree over a mesh has its triangles, not their numbers alone.
KERNEL bool has_packed_triangles(const MeshView& mesh) {
  return mesh.segments == 0 && mesh.shape == Shape::kTriangles;
}
/// A triangle of a mesh that does not deform while the shutter is open.
KERNEL BvhTriangle bvh_triangle(const MeshView& mesh, u32 number) {
  const uvec3 corners = mesh.triangles[number];
  return {mesh.positions[corners.x], number, mesh.positions[corners.y], 0,
          mesh.positions[corners.z], 0};
}

/// Returns what a ray needs to enter an instance.
///
/// mesh   the tree over its mesh
KERNEL BvhInstance bvh_instance(const InstanceView& instance, u32 number, const MeshBvh& mesh) {
  BvhInstance item{};
  const mat4x3& m = instance.object_from_world;
  for (int k = 0; k < 3; ++k) item.object_from_world[k] = {m[0][k], m[1][k], m[2][k], m[3][k]};
  item.nodes = mesh.nodes;
  item.triangles = mesh.triangles;
  item.instance = number;
  item.mesh = instance.mesh;
  item.visibility = instance.visibility;
  item.flags = (instance.segments > 0 ? u32(kBvhMoves) : 0) | (mesh.nodes ? 0 : u32(kBvhShape));
  return item;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
