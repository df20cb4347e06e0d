// Which volumes a ray may meet: a walk through a binary tree over their boxes. Called by volume.h
// and volume_march.h.
#pragma once

#include "kernels/media/volume_grid.h"
#include "kernels/scene/ray.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Where a ray enters a box before t_max; INFINITY: nowhere.
KERNEL float entry_of(const VolumeNode& node, const Ray& ray, float t_max) {
  const Span span = span_in_box(node.lower, node.upper, ray.origin, ray.direction, t_max);
  return span.begin < span.end ? span.begin : INFINITY;
}

/// Calls visit(volume, t_max) for the volumes whose boxes a ray of these kinds meets before t_max,
/// until it is false; visit may shorten t_max.
template <class Visit>
KERNEL void visit_volumes(const SceneView& scene, const Ray& ray, u32 mask, float t_max,
                          const Visit& visit) {
  struct Later {
    u32 node;
    float entry;
  } later[kVolumeTreeDepth];
  u32 waiting = 0;
  if (scene.volume_count == 0) return;
  for (u32 at = 0;;) {
    const VolumeNode& node = scene.volume_nodes[at];
    if (node.is_leaf) {
      const bool meets = scene.volumes[node.first].instance.visibility & mask;
      if (meets && !visit(node.first, t_max)) return;
    } else {
      Later near{node.first, entry_of(scene.volume_nodes[node.first], ray, t_max)};
      Later far{node.first + 1, entry_of(scene.volume_nodes[node.first + 1], ray, t_max)};
      if (far.entry < near.entry) {
        const Later first = far;
        far = near;
        near = first;
      }
      if (far.entry < INFINITY) later[waiting++] = far;
      if (near.entry < INFINITY) {
        at = near.node;
        continue;
      }
    }
    while (waiting > 0 && later[waiting - 1].entry > t_max) --waiting;
    if (waiting == 0) return;
    at = later[--waiting].node;
  }
}

}  // namespace heliograph::kernels::inline HELIO_ISA
