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

/// Squares of lengths in metres between which directions are exact enough to aim.
inline constexpr float kShortest2 = 1e-30f, kLongest2 = 1e30f;

/// The cones in which a point sees the scene's casters, and images of lights in them. Which cone is
/// whose does not depend on the point; those that it does not see weigh nothing.
template <class F>
struct CasterConesOf {
  u32 count = 0;
  F probability{0};          // of a direction towards one of them; the rest are the surface's own
  Vec3<F> axis[kMostCones];  // unit, world
  F depth[kMostCones];       // 1 - cosine of the half angle: the solid angle over 2 pi
  F sum[kMostCones];         // running, of their weights
};
using CasterCones = CasterConesOf<float>;

template <class F>
KERNEL void add_cone(CasterConesOf<F>& cones, BoolOf<F> seen, Vec3<F> axis, F depth, F weight) {
  if (!any(seen)) return;
  const F before = cones.count > 0 ? cones.sum[cones.count - 1] : F(0);
  cones.axis[cones.count] = axis;
  cones.depth[cones.count] = select(seen, depth, F(1));
  cones.sum[cones.count++] = before + select(seen, weight, F(0));
}

/// The direction of a vector; a shorter one where that is hardly known.
template <class F>
KERNEL Vec3<F> towards(Vec3<F> v) {
  return v * (1 / sqrt(max2(dot(v, v), F(kShortest2))));
}

/// Adds a cone in which p sees a light in a caster, unless it is little smaller than the caster.
///
/// whole    depth of the caster's own cone
template <class F>
KERNEL void add_image(CasterConesOf<F>& cones, const CasterView& caster, const CastLightView& light,
                      Vec3<F> p, BoolOf<F> seen, F whole, F weight) {
  constexpr u32 kSteps = 2;  // the error is then small against the images of lamps
  constexpr float kLargest = 0.5f, kSmallest = 1e-4f;  // of a smaller one rounding shows
  const Vec3<F> center(caster.center), lamp(light.center);
  const F radius(caster.radius);
  Vec3<F> normal = towards(towards(p - center) + towards(lamp - center));
  Vec3<F> q = center + normal * radius;
  for (u32 i = 0; i < kSteps; ++i) {
    normal = towards(towards(p - q) + towards(lamp - q));
    q = center + normal * radius;
  }
  const Vec3<F> d = q - p, from_lamp = lamp - q;
  const F distance2 = dot(d, d), distance = sqrt(distance2);
  const F cosine = -dot(normal, d) / distance;
  const F angular = light.radius / max2(sqrt(dot(from_lamp, from_lamp)), F(light.radius));
  const F angle = (angular + caster.spread) / (1 + 2 * distance * cosine / radius);
  const F depth = max2(0.5f * sqr(angle), F(kSmallest));
  const BoolOf<F> known = (distance2 > F(kShortest2)) & (distance2 < F(kLongest2));
  add_cone(cones, seen & known & (cosine > F(0)) & (depth < kLargest * whole), d / distance, depth,
           weight);
}

/// n   unit, at p; world
template <class F>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL void gather_caustic_targets(CasterConesOf<F>& cones,
                                                                   const SceneView& scene,
                                                                   Vec3<F> p, Vec3<F> n) {
  constexpr float kFlattest = 0.1f;  // cosine that the weight of a low one has
  // Sum of the casters' own cones, as shares of the hemisphere weighed by the cosine, that takes
  // the whole probability. Of 0.01 to 0.1 the most that has no more variance in W1; a plain with a
  // few small casters (W4) takes 1.08 times as long as without any, where it took 1.47 times.
  constexpr float kLarge = 0.03f;
  F sum(0);
  u32 room = kMostCones - scene.caster_count;  // each has its own cone
  for (u32 i = 0; i < scene.caster_count; ++i) {
    const CasterView& caster = scene.casters[i];
    const u32 images = caster.mirror > 0 ? min2(scene.cast_light_count, room) : 0;
    room -= images;
    const Vec3<F> d = Vec3<F>(caster.center) - p;
    const F distance2 = dot(d, d), height = dot(d, n);
    const BoolOf<F> seen = (distance2 > F(max2(sqr(caster.radius), kShortest2))) &
                           (distance2 < F(kLongest2)) & (height > F(-caster.radius));
    if (!any(seen)) continue;
    const F inverse = 1 / sqrt(distance2);
    const F sine2 = sqr(caster.radius * inverse);
    const F depth = sine2 / (1 + safe_sqrt(1 - sine2));
    const F weight = depth * max2(height * inverse, F(kFlattest));
    sum += select(seen, weight, F(0));
    add_cone(cones, seen, d * inverse, depth, weight);
    for (u32 k = 0; k < images; ++k)
      add_image(cones, caster, scene.cast_lights[k], p, seen, depth, caster.mirror * weight);
  }
  cones.probability = scene.caster_probability * min2(F(1), sum / kLarge);
}

/// Density of sample_casters(), 1/sr; 0 where no caster is seen. wi: unit, world
template <class F>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL F casters_pdf(const CasterConesOf<F>& cones, Vec3<F> wi) {
  F pdf(0), before(0);
  for (u32 i = 0; i < cones.count; ++i) {
    const F weight = cones.sum[i] - before;
    before = cones.sum[i];
    pdf += select(1 - dot(wi, cones.axis[i]) <= cones.depth[i], weight / cones.depth[i], F(0));
  }
  return select(before > F(0), pdf / (2 * kPi * before), F(0));
}

/// A direction towards a caster, and what is left of the choice, in [0, 1).
template <class F>
struct CasterDirectionOf {
  Vec3<F> wi;  // unit, world
  F rest;
};
/// Where a caster is seen.
template <class F>
KERNEL CasterDirectionOf<F> sample_casters(const CasterConesOf<F>& cones, F choice, Vec2<F> u) {
  const F whole = cones.sum[cones.count - 1];
  const F at = min2(choice, F(1 - 0x1p-22f)) * whole;  // below the whole when rounded, too
  Vec3<F> axis = cones.axis[0];
  F depth = cones.depth[0], start(0), end = cones.sum[0];
  for (u32 i = 1; i < cones.count; ++i) {
    const BoolOf<F> later = at >= end;
    axis = select(later, cones.axis[i], axis);
    depth = select(later, cones.depth[i], depth);
    start = select(later, cones.sum[i - 1], start);
    end = select(later, cones.sum[i], end);
  }
  return {sample_cone(axis, depth, u), rescale_uniform(at - start, end - start)};
}

}  // namespace heliograph::kernels::inline HELIO_ISA
