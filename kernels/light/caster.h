// Directions towards what may focus light: caustics are rare among a surface's own directions.
// Called by direct_light.h and path.h.
//
// Source: Jensen 1996, "Global Illumination using Photon Maps", section 3.2 (projection maps: aim
// at specular objects), here from the receiver; mixed with the surface's own directions as
// Hesterberg 1995, "Weighted Average Importance Sampling and Defensive Mixture Distributions".
// Within a caster the images of lights are looked at more often, as if it were a mirror ball: where
// they are solves Alhazen's problem, how large they are follows from its curvature.
#pragma once

#include "kernels/core/warp.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Paths look for casters from so many of their vertices, the first ones.
inline constexpr u32 kCasterEdges = 2;

inline constexpr u32 kMostCones = 16;

/// The cones in which a point sees the scene's casters, and images of lights in them.
struct CasterCones {
  u32 count = 0;
  float probability = 0;    // of a direction towards one of them; the rest are the surface's own
  vec3 axis[kMostCones];    // unit, world
  float depth[kMostCones];  // 1 - cosine of the half angle: the solid angle over 2 pi
  float sum[kMostCones];    // running, of their weights
};

KERNEL void add_cone(CasterCones& cones, vec3 axis, float depth, float weight) {
  const float before = cones.count > 0 ? cones.sum[cones.count - 1] : 0;
  cones.axis[cones.count] = axis;
  cones.depth[cones.count] = depth;
  cones.sum[cones.count++] = before + weight;
}

/// Adds a cone in which p sees a light in a caster, unless it is little smaller than the caster.
///
/// whole    depth of the caster's own cone
KERNEL void add_image(CasterCones& cones, const CasterView& caster, const CastLightView& light,
                      vec3 p, float whole, float weight) {
  constexpr u32 kSteps = 2;  // the error is then small against the images of lamps
  constexpr float kLargest = 0.5f, kSmallest = 1e-4f;  // of a smaller one rounding shows
  vec3 normal = normalize_or(normalize_or(p - caster.center, vec3(0)) +
                                 normalize_or(light.center - caster.center, vec3(0)),
                             vec3(0));
  vec3 q = caster.center + caster.radius * normal;
  for (u32 i = 0; i < kSteps; ++i) {
    normal = normalize_or(normalize_or(p - q, vec3(0)) + normalize_or(light.center - q, vec3(0)),
                          normal);
    q = caster.center + caster.radius * normal;
  }
  const vec3 d = q - p;
  const float distance = length(d);
  const float cosine = -dot(normal, d) / distance;
  if (!(cosine > 0)) return;
  const float seen = light.radius / max2(length(light.center - q), light.radius) + caster.spread;
  const float angle = seen / (1 + 2 * distance * cosine / caster.radius);
  const float depth = max2(0.5f * sqr(angle), kSmallest);
  if (depth < kLargest * whole) add_cone(cones, d / distance, depth, weight);
}

/// n   unit, at p; world
HELIO_STEP KERNEL void see_casters(CasterCones& cones, const SceneView& scene, vec3 p, vec3 n) {
  constexpr float kFlattest = 0.1f;  // cosine that the weight of a low one has
  // What the casters' own cones add up to, as shares of the hemisphere weighed by the cosine, for
  // the whole probability. Of 0.01 to 0.1 the most that has no more variance in W1; a plain with a
  // few small casters (W4) takes 1.08 times as long as without any, where it took 1.47 times.
  constexpr float kLarge = 0.03f;
  float seen = 0;
  for (u32 i = 0; i < scene.caster_count; ++i) {
    const CasterView& caster = scene.casters[i];
    const vec3 d = caster.center - p;
    const float distance2 = dot(d, d);
    const float height = dot(d, n);
    if (distance2 <= sqr(caster.radius) || height <= -caster.radius) continue;
    const float inverse = 1 / std::sqrt(distance2);
    const float sine2 = sqr(caster.radius * inverse);
    const float depth = sine2 / (1 + std::sqrt(1 - sine2));
    const float weight = depth * max2(height * inverse, kFlattest);
    seen += weight;
    add_cone(cones, d * inverse, depth, weight);
    if (caster.mirror == 0) continue;
    const u32 most = kMostCones - (scene.caster_count - 1 - i);  // each has its own cone
    for (u32 k = 0; k < scene.cast_light_count && cones.count < most; ++k)
      add_image(cones, caster, scene.cast_lights[k], p, depth, caster.mirror * weight);
  }
  cones.probability = scene.caster_probability * min2(1.0f, seen / kLarge);
}

/// Density of sample_casters(), 1/sr. wi: unit, world
HELIO_STEP KERNEL float casters_pdf(const CasterCones& cones, vec3 wi) {
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
