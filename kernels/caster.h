// Directions towards what may focus light: caustics are rare among a surface's own directions.
// Called by direct_light.h and path.h.
//
// Source: Jensen 1996, "Global Illumination using Photon Maps", section 3.2 (projection maps: aim
// at specular objects), here from the receiver; mixed with the surface's own directions as
// Hesterberg 1995, "Weighted Average Importance Sampling and Defensive Mixture Distributions".
#pragma once

#include "kernels/scene_view.h"
#include "kernels/warp.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Paths look for casters from so many of their vertices, the first ones.
inline constexpr u32 kCasterEdges = 2;

/// The cones in which a point sees the scene's casters.
struct CasterCones {
  u32 count = 0;
  float probability = 0;      // of a direction towards one of them; the rest are the surface's own
  vec3 axis[kMostCasters];    // unit, world
  float depth[kMostCasters];  // 1 - cosine of the half angle: the solid angle over 2 pi
  float sum[kMostCasters];    // running, of their weights
};

/// n   unit, at p; world
KERNEL void see_casters(CasterCones& cones, const SceneView& scene, vec3 p, vec3 n) {
  constexpr float kFlattest = 0.1f;  // cosine that the weight of a low one has
  float sum = 0;
  for (u32 i = 0; i < scene.caster_count; ++i) {
    const CasterView& caster = scene.casters[i];
    const vec3 d = caster.center - p;
    const float distance2 = dot(d, d);
    const float height = dot(d, n);
    if (distance2 <= sqr(caster.radius) || height <= -caster.radius) continue;
    const float inverse = 1 / std::sqrt(distance2);
    const float sine2 = sqr(caster.radius * inverse);
    const float depth = sine2 / (1 + std::sqrt(1 - sine2));
    sum += depth * max2(height * inverse, kFlattest);
    cones.axis[cones.count] = d * inverse;
    cones.depth[cones.count] = depth;
    cones.sum[cones.count++] = sum;
  }
  if (cones.count > 0) cones.probability = scene.caster_probability;
}

/// Density of sample_casters(), 1/sr. wi: unit, world
KERNEL float casters_pdf(const CasterCones& cones, vec3 wi) {
  float pdf = 0;
  float before = 0;
  for (u32 i = 0; i < cones.count; ++i) {
    if (1 - dot(wi, cones.axis[i]) <= cones.depth[i])
      pdf += (cones.sum[i] - before) / cones.depth[i];
    before = cones.sum[i];
  }
  return pdf / (2 * kPi * cones.sum[cones.count - 1]);
}

/// A direction towards a caster, and what is left of the choice, in [0, 1).
struct CasterDirection {
  vec3 wi;  // unit, world
  float rest;
};
KERNEL CasterDirection sample_casters(const CasterCones& cones, float choice, vec2 u) {
  const Choice caster = choose(cones.sum, cones.count, choice * cones.sum[cones.count - 1]);
  return {sample_cone(cones.axis[caster.index], cones.depth[caster.index], u), caster.rest};
}

}  // namespace heliograph::kernels::inline HELIO_ISA
