// Sheen of cloth: microfibres that stand up. Local frames as in ggx.h. Called by layers.h.
//
// Source: Conty and Kulla 2017, "Production Friendly Microfacet Sheen BRDF".
#pragma once

#include "kernels/bsdf/ggx.h"
#include "kernels/bsdf/sheen_tables.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Sheen of a roughness; below kSheenSmoothest it stays there, since the model would give off more
/// than it gets.
struct Sheen {
  float roughness;
  float alpha;
  float half;               // the fit at cosine 1/2
  float a, b, power, d, e;  // of the fit of Lambda
};

KERNEL float sheen_fit(const Sheen& s, float x) {
  return s.a / (1 + s.b * std::pow(x, s.power)) + s.d * x + s.e;
}

KERNEL Sheen make_sheen(float roughness) {
  Sheen s;
  s.roughness = max2(roughness, kSheenSmoothest);
  s.alpha = sqr(s.roughness);
  const float smooth = sqr(1 - s.alpha);
  s.a = 21.5473f + (25.3245f - 21.5473f) * smooth;
  s.b = 3.82987f + (3.32435f - 3.82987f) * smooth;
  s.power = 0.19823f + (0.16801f - 0.19823f) * smooth;
  s.d = -1.97760f + (-1.27393f + 1.97760f) * smooth;
  s.e = -4.32054f + (-4.85967f + 4.32054f) * smooth;
  s.half = sheen_fit(s, 0.5f);
  return s;
}

KERNEL float sheen_lambda(const Sheen& s, float cosine) {
  if (cosine < 0.5f) return std::exp(sheen_fit(s, cosine));
  return std::exp(2 * s.half - sheen_fit(s, max2(1 - cosine, 0.0f)));
}

/// D(h) G(wo, wi) / (4 wo.z), which is the reflection times the cosine of wi.
KERNEL float sheen_reflection(const Sheen& s, vec3 wo, vec3 wi) {
  const vec3 h = normalize(wo + wi);
  const float sine2 = max2(1 - h.z * h.z, 0.0f);
  const float density = (2 + 1 / s.alpha) * std::pow(sine2, 0.5f / s.alpha) * (0.5f * kInvPi);
  return density / (4 * wo.z * (1 + sheen_lambda(s, wo.z) + sheen_lambda(s, wi.z)));
}

/// Share by which albedos between the entries of the table may be too small.
inline constexpr float kSheenMargin = 1e-3f;

/// Share of light that white sheen reflects, never too small.
KERNEL float sheen_albedo(const Sheen& s, float cosine) {
  const Place r = place_at(
      (s.roughness - kSheenSmoothest) * (float(kSheenRoughnesses - 1) / (1 - kSheenSmoothest)),
      kSheenRoughnesses);
  const Place c = place_at(std::sqrt(clamp01(cosine)) * (kSheenCosines - 1), kSheenCosines);
  const float* a = kSheenAlbedo + r.index * kSheenCosines + c.index;
  const float* b = a + kSheenCosines;
  const float low = a[0] + (a[1] - a[0]) * c.weight;
  const float high = b[0] + (b[1] - b[0]) * c.weight;
  return min2((low + (high - low) * r.weight) * (1 + kSheenMargin), 1.0f);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
