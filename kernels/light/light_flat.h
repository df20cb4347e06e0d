// Lights of a few triangles that stand still and shine evenly: their triangles in the world, which
// lanes read (flat_lanes.h). Called by who makes lights.
#pragma once

#include "kernels/light/light_surface.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// True if a light is_even(), shows to all rays that scatter, stands still, and is of
/// triangles that one leaf holds.
KERNEL bool is_flat(const LightPlace& at) {
  const TriangleTree& tree = at.light.tree;
  return is_even(at.light, at.instance) && shows_to_all(at.instance.visibility) &&
         at.instance.segments == 0 && at.mesh.segments == 0 && at.mesh.shape == Shape::kTriangles &&
         tree.nodes[tree.root].count > 0;
}

/// The row of an entry of such a light.
KERNEL FlatTriangle flat_triangle(const LightPlace& at, u32 entry) {
  const LightTriangle t = light_triangle(at, entry);
  const TriangleEntry& e = at.light.tree.entries[entry];
  const float offset = plane_error(at.pose.world_from_object, t.corners, normalize(t.normal));
  return {t.a,  e.radiosity, t.ab,     e.power,
          t.ac, offset,      t.normal, emits_back(at.light) ? 1.f : 0.f};
}
/// Adds the rows of a light that is one.
template <class Rows>
KERNEL void add_flat_triangles(LightView& light, const InstanceView& instance, const MeshView& mesh,
                               Rows& rows) {
  const LightPlace at{
      light, instance, mesh, {instance.world_from_object, instance.object_from_world}, 0};
  if (!is_flat(at)) return;
  light.flat = u32(rows.size());
  const LightNode& leaf = light.tree.nodes[light.tree.root];
  for (u32 k = 0; k < leaf.count; ++k) rows.push_back(flat_triangle(at, leaf.first + k));
}

}  // namespace heliograph::kernels::inline HELIO_ISA
