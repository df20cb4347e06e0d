// Parts of a walk that few rays need: holes, motion and deformation, primitives that are no
// triangles. They stay out of the walk, and take none of its state by reference. Called by
// bvh_tracer.h.
#pragma once

#include "kernels/bvh/bvh_meet.h"
#include "kernels/geometry/accept.h"
#include "kernels/geometry/primitive.h"

namespace heliograph::kernels::inline HELIO_ISA {

HELIO_RARE KERNEL bool is_hole(const SceneView& scene, HoleKey holes, Hit hit) {
  if (!(scene.instances[hit.instance].flags & kMayBeHole)) return false;
  Ray ray{};
  ray.holes = holes;
  return !accepts(scene, ray, hit);
}

/// Where a vertex of a mesh that may deform is, the same for each triangle at it.
KERNEL vec3 vertex_at(const MeshView& mesh, u32 vertex, float time) {
  if (mesh.segments == 0) return mesh.positions[vertex];
  const Segment s = segment_at(mesh.segments, time);
  const vec3* from = mesh.positions + u64(s.index) * mesh.vertex_count + vertex;
  const vec3 to = from[mesh.vertex_count];
  return {product(from->x, 1 - s.u) + product(to.x, s.u),
          product(from->y, 1 - s.u) + product(to.y, s.u),
          product(from->z, 1 - s.u) + product(to.z, s.u)};
}

/// An item of a mesh that deforms.
struct DeformedItem {
  u32 i;
  float time;
};
HELIO_RARE KERNEL BvhTriangle deformed_triangle(const SceneView& scene, const BvhView& bvh,
                                                u32 mesh, DeformedItem item) {
  const u32 number = bvh.meshes[mesh].triangle_numbers[item.i];
  const MeshView& view = scene.meshes[mesh];
  const uvec3 vertices = view.triangles[number];
  return {vertex_at(view, vertices.x, item.time), number, vertex_at(view, vertices.y, item.time), 0,
          vertex_at(view, vertices.z, item.time), 0};
}

/// A ray in an object's space.
struct ObjectRay {
  vec3 origin, direction;
};

/// Where a segment of a strand is met by a ray of its object space; at NAN where it is not.
HELIO_RARE KERNEL Hit segment_hit(const SceneView& scene, const BvhView& bvh, u32 item,
                                  DeformedItem segment, ObjectRay ray) {
  const BvhInstance& instance = bvh.items[item];
  const u32 number = bvh.meshes[instance.mesh].triangle_numbers[segment.i];
  ShapeHit hit;
  if (!Curves::meet({scene.meshes[instance.mesh], number, segment.time},
                    {ray.origin, ray.direction, INFINITY}, hit))
    return {NAN, kNone, kNone, 0, 0};
  return {hit.t, instance.instance, number, hit.place.x, hit.place.y};
}
KERNEL ObjectRay object_ray(const BvhInstance& instance, const ObjectRay& world) {
  const vec3 o = world.origin, d = world.direction;
  ObjectRay ray;
  HELIO_UNROLL
  for (int k = 0; k < 3; ++k) {
    const Words4 words = load_words(&instance.object_from_world[k]);
    const vec3 row = vec3_of_bits(words);
    ray.direction[k] = row.x * d.x + row.y * d.y + row.z * d.z;
    ray.origin[k] = row.x * o.x + row.y * o.y + row.z * o.z + float_of_bits(words.w);
  }
  return ray;
}
HELIO_RARE KERNEL ObjectRay moving_object_ray(const SceneView& scene, u32 instance, float time,
                                              ObjectRay world) {
  const mat4x3 m = pose_at(scene, scene.instances[instance], time).object_from_world;
  return {transform_point(m, world.origin), transform_vector(m, world.direction)};
}

/// Where an instance that shows a disc or a sphere is met by a ray of its object space; at NAN
/// where it is not.
KERNEL Hit shape_hit(const SceneView& scene, const BvhInstance& item, ObjectRay ray) {
  ShapeHit hit;
  if (!meet_shape(scene.meshes[item.mesh].shape, {ray.origin, ray.direction, INFINITY}, hit))
    return {NAN, kNone, kNone, 0, 0};
  return {hit.t, item.instance, 0, hit.place.x, hit.place.y};
}

}  // namespace heliograph::kernels::inline HELIO_ISA
