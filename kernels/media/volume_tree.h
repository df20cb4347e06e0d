// Which volumes a ray may meet: a walk through a binary tree over their boxes. Called by volume.h
// and volume_march.h.
#pragma once

#include "kernels/scene/ray.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Where a ray enters a box before t_max; INFINITY: nowhere.
///
/// Source: Kay and Kajiya 1986, "Ray Tracing Complex Scenes", section 3 (slabs).
KERNEL float entry_of(const VolumeNode& node, const Ray& ray, float t_max) {
  float begin = 0, end = t_max;
  for (int i = 0; i < 3; ++i) {
    const float origin = ray.origin[i];
    if (ray.direction[i] == 0) {
      if (origin < node.lower[i] || origin > node.upper[i]) return INFINITY;
      continue;
    }
    const float inverse = 1 / ray.direction[i];
    const float a = (node.lower[i] - origin) * inverse;
    const float b = (node.upper[i] - origin) * inverse;
    begin = max2(begin, min2(a, b));
    end = min2(end, max2(a, b));
  }
  return begin <= end ? begin : INFINITY;
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
