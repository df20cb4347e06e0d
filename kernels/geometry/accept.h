// Cut-outs and partial opacity: whether a ray meets a surface that it reaches. Called by every
// Tracer for instances with kMayBeHole.
#pragma once

#include "kernels/core/hash.h"
#include "kernels/material/material.h"
#include "kernels/scene/ray.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// True if the ray meets the surface at `hit`. Depends on the ray's key, the instance and the
/// primitive alone, so that the order of traversal does not matter.
KERNEL bool accepts(const SceneView& scene, const Ray& ray, const Hit& hit) {
  const float opacity = opacity_at(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v));
  if (ray.holes.probe) return opacity >= 0.5f;
  if (opacity >= 1) return true;
  if (!(opacity > 0)) return false;
  const u32 bits =
      hash32(ray.holes.key ^ hash32(hit.instance * 0x9e3779b9u + hash32(hit.primitive)));
  return unit_float(bits) < opacity;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
