// Sheen of cloth: microfibres that stand up. Local frames as in ggx.h. Called by layers.h.
//
// Source: Conty and Kulla 2017, "Production Friendly Microfacet Sheen BRDF".
#pragma once

#include "kernels/bsdf/ggx.h"
#include "kernels/bsdf/sheen_tables.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Sheen of a roughness; below kSheenSmoothest it stays there, since the model would give off more
/// than it gets.
template <class F>
struct SheenOf {
  F roughness;
  F alpha;
  F half;               // the fit at cosine 1/2
  F a, b, power, d, e;  // of the fit of Lambda
};

template <class F>
KERNEL F sheen_fit(const SheenOf<F>& s, F x) {
  return s.a / (1 + s.b * pow(x, s.power)) + s.d * x + s.e;
}

template <class F>
KERNEL SheenOf<F> make_sheen(F roughness) {
  SheenOf<F> s;
  s.roughness = max2(roughness, F(kSheenSmoothest));
  s.alpha = sqr(s.roughness);
  const F smooth = sqr(1 - s.alpha);
  s.a = 21.5473f + (25.3245f - 21.5473f) * smooth;
  s.b = 3.82987f + (3.32435f - 3.82987f) * smooth;
  s.power = 0.19823f + (0.16801f - 0.19823f) * smooth;
  s.d = -1.97760f + (-1.27393f + 1.97760f) * smooth;
  s.e = -4.32054f + (-4.85967f + 4.32054f) * smooth;
  s.half = sheen_fit(s, F(0.5f));
  return s;
}

template <class F>
KERNEL F sheen_lambda(const SheenOf<F>& s, F cosine) {
  const BoolOf<F> low = cosine < 0.5f;
  const F fit = sheen_fit(s, select(low, cosine, max2(1 - cosine, F(0))));
  return exp(F(select(low, fit, 2 * s.half - fit)));
}

/// D(h) G(wo, wi) / (4 wo.z), which is the reflection times the cosine of wi.
template <class F>
KERNEL F sheen_reflection(const SheenOf<F>& s, Vec3<F> wo, Vec3<F> wi) {
  const Vec3<F> h = normalize(wo + wi);
  const F sine2 = max2(1 - h.z * h.z, F(0));
  const F density = (2 + 1 / s.alpha) * pow(sine2, F(0.5f / s.alpha)) * (0.5f * kInvPi);
  return density / (4 * wo.z * (1 + sheen_lambda(s, wo.z) + sheen_lambda(s, wi.z)));
}

/// Share by which albedos between the entries of the table may be too small.
inline constexpr float kSheenMargin = 1e-3f;

/// Share of light that white sheen reflects, never too small.
template <class F>
KERNEL F sheen_albedo(const SheenOf<F>& s, F cosine) {
  const auto r = place_at(
      (s.roughness - kSheenSmoothest) * (float(kSheenRoughnesses - 1) / (1 - kSheenSmoothest)),
      kSheenRoughnesses);
  const auto c = place_at(sqrt(clamp01(cosine)) * float(kSheenCosines - 1), kSheenCosines);
  const IntOf<F> at = r.index * i32(kSheenCosines) + c.index;
  const auto between = [&](i32 step) {
    const F first = gather(kSheenAlbedo, at + step);
    return first + (gather(kSheenAlbedo, at + step + 1) - first) * c.weight;
  };
  const F low = between(0);
  return min2((low + (between(i32(kSheenCosines)) - low) * r.weight) * (1 + kSheenMargin), F(1));
}

}  // namespace heliograph::kernels::inline HELIO_ISA
