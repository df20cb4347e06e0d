// Where albedos lie in ggx_tables.h, and as what. Shared by ggx.h, which reads them, and
// scripts/make_ggx_tables.cpp, which writes them.
#pragma once

#include "kernels/core/math.h"

namespace heliograph::kernels::inline HELIO_ISA {

inline constexpr u32 kAlbedoRoughnesses = 32, kAlbedoCosines = 48;
inline constexpr u32 kAnisotropies = 13, kAnisotropicRoughnesses = 20;
inline constexpr u32 kAnisotropicPhis = 6, kAnisotropicCosines = 28;
/// Seen from inside, glass changes faster. The middle cosine is the critical one's: their number is
/// odd.
inline constexpr u32 kEnteringIors = 16, kEnteringRoughnesses = 16, kEnteringCosines = 25;
inline constexpr u32 kLeavingIors = 28, kLeavingRoughnesses = 28, kLeavingCosines = 41;

/// Aspect of the last row of anisotropic tables: the root of 0.1.
inline constexpr float kLeastAspect = 0.316227766f;
/// Index of refraction of the first row of tables of glass, and the places of the first and last,
/// which is 4.
inline constexpr float kLeastIor = 1.01f;
inline constexpr float kLeastIorRoot = 0.0705345616f, kLargestIorRoot = 0.774596669f;

/// [0, 1] onto itself, as dense about 0 as `scale` asks for.
template <class F>
KERNEL F dense_place(F x, F scale) {
  return x * (1 + scale) / (x + scale);
}
/// Half by scale, half by the root.
template <class F>
KERNEL F axis_place(F x, F scale) {
  return F(0.5f) * (dense_place(x, scale) + sqrt(x));
}

/// Scale of the light that microfacets lose at a cosine: divided by it, the loss is nearly constant
/// in alpha and in the cosine. Tables hold that quotient.
template <class F>
KERNEL F loss_scale(F cosine, F alpha) {
  const F alpha2 = sqr(alpha);
  return alpha2 / (alpha2 + sqr(cosine));
}

/// Places of an index of refraction above 1, and of an aspect, from 0 to 1 in their tables.
template <class F>
KERNEL F ior_place(F ior) {
  return (sqrt((ior - 1) / (ior + 1)) - kLeastIorRoot) / (kLargestIorRoot - kLeastIorRoot);
}
template <class F>
KERNEL F aspect_place(F aspect) {
  return (1 - aspect) / (1 - kLeastAspect);
}

/// Place of a cosine in glass. From inside, total reflection begins at the middle, whatever eta is,
/// and as sharply as alpha lets it: cosines of microfacets differ by alpha times the sine.
template <class F>
KERNEL F glass_place(F cosine, F alpha, F eta) {
  const F critical = safe_sqrt(1 - eta * eta);
  const F width = alpha * (eta + F(0.5f) * alpha);
  const auto reflected = [&] {
    const F above = 1 - critical, x = (cosine - critical) / above;
    return F(0.5f) + F(0.25f) * (dense_place(x, width / above) + x);
  };
  const auto refracted = [&] {
    const F x = cosine / critical;
    return (dense_place(x, alpha / critical) + 1 - dense_place(1 - x, width / critical) + x) / 6;
  };
  return either(
      eta > 1, [&] { return axis_place(cosine, alpha); },
      [&] { return either(cosine >= critical, reflected, refracted); });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
