// Maps from the unit square to the distributions that renderers need, and their densities.
#pragma once

#include "kernels/core/math.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Uniform on the unit disk.
///
/// Source: Shirley and Chiu 1997, "A Low Distortion Map Between Disk and Square".
template <class F>
KERNEL Vec2<F> sample_disk(Vec2<F> u) {
  const F a = 2 * u.x - 1;
  const F b = 2 * u.y - 1;
  const BoolOf<F> wide = abs(a) > abs(b);
  const F r = select(wide, a, b);
  const F turns = 0.125f * select(wide, b, a) / select(r == 0, F(1), r);
  const SinCosOf<F> phi = sincos_turns(select(wide, turns, 0.25f - turns));
  return Vec2<F>(r * phi.cos, r * phi.sin);
}

/// Hemisphere about +z with density cos / pi.
template <class F>
KERNEL Vec3<F> sample_cosine(Vec2<F> u) {
  const Vec2<F> d = sample_disk(u);
  return Vec3<F>(d.x, d.y, safe_sqrt(1 - d.x * d.x - d.y * d.y));
}

/// Sphere with density 1 / 4 pi.
KERNEL vec3 sample_sphere(vec2 u) {
  const float z = 1 - 2 * u.x;
  const float r = safe_sqrt(1 - z * z);
  const SinCos phi = sincos_turns(u.y);
  return vec3(r * phi.cos, r * phi.sin, z);
}

/// Uniform in a cone about a unit axis. depth: 1 - cosine of its half angle
template <class F>
KERNEL Vec3<F> sample_cone(Vec3<F> axis, F depth, Vec2<F> u) {
  const F drop = u.x * depth;
  const F r = safe_sqrt(drop * (2 - drop));
  const SinCosOf<F> phi = sincos_turns(u.y);
  return to_world(make_frame(axis), Vec3<F>(r * phi.cos, r * phi.sin, 1 - drop));
}

/// Weights of a triangle's vertices 1 and 2, uniform in area.
///
/// Source: Heitz 2019, "A Low-Distortion Map Between Triangle and Square".
template <class F>
KERNEL Vec2<F> sample_triangle(Vec2<F> u) {
  const F a = 0.5f * u.x, b = 0.5f * u.y;
  return select(u.y > u.x, Vec2<F>(a, u.y - a), Vec2<F>(u.x - b, b));
}

/// The interval of a running sum that u in [0, total) falls into, and u's place in it.
template <class F>
struct ChoiceOf {
  IndexOf<F> index;
  F probability;  // of the interval, as the sums have it
  F rest;         // uniform in [0, 1)
};
using Choice = ChoiceOf<float>;
/// The interval of an entry.
///
/// cdf     sums up to and including each entry; those of the table begin at `begin`
template <class F>
struct IntervalOf {
  F start, length;

  KERNEL IntervalOf(const float* cdf, IndexOf<F> begin, IndexOf<F> entry) {
    const IndexOf<F> at = begin + entry;
    const BoolOf<F> first = entry == IndexOf<F>(0);
    start = select(first, F(0), gather(cdf, select(first, at, at - IndexOf<F>(1))));
    length = gather(cdf, at) - start;
  }
};
/// first, count   the entries to choose from; count > 0
/// u              in [0, cdf[begin + first + count - 1]]
template <class F>
KERNEL ChoiceOf<F> choose(const float* cdf, IndexOf<F> begin, IndexOf<F> first, IndexOf<F> count,
                          F u) {
  for (;;) {
    const BoolOf<F> several = IndexOf<F>(1) < count;
    if (!any(several)) break;
    const IndexOf<F> half = count >> 1;
    const IndexOf<F> middle = first + half;
    const BoolOf<F> beyond =
        gather(cdf, begin + select(several, middle - IndexOf<F>(1), first)) <= u;
    first = select(several & beyond, middle, first);
    count = count - half;
  }
  const IntervalOf<F> chosen(cdf, begin, first);
  return {first, chosen.length, rescale_uniform(F(u - chosen.start), chosen.length)};
}
KERNEL Choice choose(const float* cdf, u32 count, float u) {
  return choose<float>(cdf, 0, 0, count, u);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
