// Fresnel equations, the GGX distribution of microfacets and its albedos. Local frames: z is the
// shading normal and wo.z > 0. Called by base.h and layers.h.
#pragma once

#include "kernels/bsdf/ggx_tables.h"
#include "kernels/core/math.h"
#include "kernels/core/warp.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// (1 - c)^5 of Schlick 1994, "An Inexpensive BRDF Model for Physically-based Rendering".
template <class F>
KERNEL F schlick_weight(F c) {
  const F m = 1 - clamp01(c);
  return sqr(sqr(m)) * m;
}

template <class F>
struct FresnelOf {
  F reflectance;
  F cos_t;  // of the refracted direction, > 0; 0: total internal reflection
};
using Fresnel = FresnelOf<float>;
/// Exact, unpolarised.
///
/// c     cosine of incidence, >= 0
/// eta   index of refraction of the far side over the near side's
template <class F>
KERNEL FresnelOf<F> fresnel_dielectric(F c, F eta) {
  const F eta2_sin2 = sqr(eta) - (1 - c * c);
  const BoolOf<F> total = eta2_sin2 <= 0;
  if (all(total)) return {F(1), F(0)};
  const F root = sqrt(eta2_sin2);  // eta * cos_t
  const F perpendicular = (c - root) / (c + root);
  const F parallel = (sqr(eta) * c - root) / (sqr(eta) * c + root);
  return {select(total, F(1), 0.5f * (sqr(perpendicular) + sqr(parallel))),
          select(total, F(0), root / eta)};
}
KERNEL Fresnel fresnel_dielectric(float c, float eta) { return fresnel_dielectric<float>(c, eta); }

/// GGX microfacets: alpha along the local x and y.
template <class F>
struct GgxOf {
  F x, y;
};
using Ggx = GgxOf<float>;

/// Squared slope of microfacets towards w, times its squared sine.
template <class F>
KERNEL F ggx_slope2(GgxOf<F> g, Vec3<F> w) {
  return sqr(g.x * w.x) + sqr(g.y * w.y);
}

/// Smith's Lambda. w.z != 0.
///
/// Source: Heitz 2014, "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs",
/// JCGT 3(2), section 5.3.
template <class F>
KERNEL F ggx_lambda(Vec3<F> w, GgxOf<F> g) {
  return 0.5f * (sqrt(1 + ggx_slope2(g, w) / (w.z * w.z)) - 1);
}

/// Density of normals D(h), unit h.
template <class F>
KERNEL F ggx_density(Vec3<F> h, GgxOf<F> g) {
  const F xy = g.x * g.y;
  const F q = (sqr(h.x * g.y) + sqr(h.y * g.x)) / xy + xy * h.z * h.z;
  return xy / (kPi * q * q);
}

/// D(h) G1(wo) / wo.z: times |wo.h| it is the density of visible normals.
template <class F>
KERNEL F ggx_visible_density(Vec3<F> wo, F density, GgxOf<F> g) {
  return 2 * density / (wo.z + sqrt(ggx_slope2(g, wo) + wo.z * wo.z));
}

/// D(h) G2(wo, wi) / (4 wo.z wi.z), with heights correlated (Heitz 2014, section 5.4).
template <class F>
KERNEL F ggx_reflection(Vec3<F> wo, Vec3<F> wi, F density, GgxOf<F> g) {
  const F a = wi.z * sqrt(ggx_slope2(g, wo) + wo.z * wo.z);
  const F b = wo.z * sqrt(ggx_slope2(g, wi) + wi.z * wi.z);
  return 0.5f * density / (a + b);
}

/// A normal visible from wo; density D(h) G1(wo) |wo.h| / wo.z.
///
/// Source: Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps", CGF 42(8).
/// Tested: tests/unit/bsdf_test.cpp.
template <class F>
KERNEL Vec3<F> sample_ggx(Vec3<F> wo, GgxOf<F> g, Vec2<F> u) {
  const Vec3<F> w = normalize(Vec3<F>(wo.x * g.x, wo.y * g.y, wo.z));
  const F z = (1 - u.y) * (1 + w.z) - w.z;
  const F r = safe_sqrt(1 - z * z);
  const SinCosOf<F> phi = sincos_turns(u.x);
  const Vec3<F> h = Vec3<F>(r * phi.cos, r * phi.sin, z) + w;
  return normalize(Vec3<F>(h.x * g.x, h.y * g.y, max2(h.z, F(1e-7f))));
}

/// Place of a roughness among the rows of a table.
template <class F>
struct AlbedoRowOf {
  IntOf<F> row;
  F weight;  // of the next row
  F alpha;
};
using AlbedoRow = AlbedoRowOf<float>;
/// Share of light that single scattering reflects with Fresnel 1, and the same weighted by Schlick.
template <class F>
struct AlbedoOf {
  F total;
  F schlick;
};
using Albedo = AlbedoOf<float>;
template <LaneMask M, class F>
KERNEL AlbedoOf<F> select(M m, const AlbedoOf<F>& a, const AlbedoOf<F>& b) {
  return {select(m, a.total, b.total), select(m, a.schlick, b.schlick)};
}

template <class F>
KERNEL AlbedoRowOf<F> albedo_row(F roughness) {
  const F place = clamp01(roughness) * float(kAlbedoRoughnesses - 1);
  const IntOf<F> row = min2(to_int(place), IntOf<F>(kAlbedoRoughnesses - 2));
  return {row, place - to_float(row), sqr(roughness)};
}

inline constexpr float kSchlickMean = 1 / 21.0f;  // the average of Schlick's weight

/// Over all directions, by their cosines.
template <class F>
KERNEL AlbedoOf<F> albedo_average(const AlbedoRowOf<F>& row) {
  const FourOf<F> loss = gather4(kReflectionAverageLoss, row.row * 2);  // two of each row
  const F total = loss.of[0], schlick = loss.of[1], scale = sqr(row.alpha);
  return {1 - (total + (loss.of[2] - total) * row.weight) * scale,
          kSchlickMean - (schlick + (loss.of[3] - schlick) * row.weight) * scale};
}
template <class F>
KERNEL AlbedoOf<F> albedo_at(const AlbedoRowOf<F>& row, F cosine) {
  const F c = clamp01(cosine);
  const F place = axis_place(c, row.alpha) * float(kAlbedoCosines - 1);
  const IntOf<F> column = min2(to_int(max2(place, F(0))), IntOf<F>(kAlbedoCosines - 2));
  const F w = place - to_float(column);
  const IntOf<F> first = (row.row * i32(kAlbedoCosines) + column) * 2;
  const FourOf<F> a = gather4(kReflectionLoss, first);  // two of each column
  const FourOf<F> b = gather4(kReflectionLoss, first + i32(2 * kAlbedoCosines));
  const auto between = [&](u32 k) { return a.of[k] + (b.of[k] - a.of[k]) * row.weight; };
  const F total = between(0), schlick = between(1), scale = loss_scale(c, row.alpha);
  return {1 - (total + (between(2) - total) * w) * scale,
          schlick_weight(c) - (schlick + (between(3) - schlick) * w) * scale};
}

/// A row of the tables for anisotropic microfacets.
template <class F>
struct AnisotropicRowOf {
  F roughness;
  F aspect;  // square root of alpha along y over alpha along x; 1: isotropic
};

/// Place of a number between n entries of a table, x from 0 to n - 1.
template <class F>
struct PlaceOf {
  IntOf<F> index;
  F weight;  // of the next entry

  /// Weight of the entry (step 0), or of the next one.
  [[nodiscard]] KERNEL F weight_of(i32 step) const { return step ? weight : 1 - weight; }
};
template <class F>
KERNEL PlaceOf<F> place_at(F x, u32 n) {
  const F inside = min2(max2(x, F(0)), F(float(n - 1)));
  const IntOf<F> index = min2(to_int(inside), IntOf<F>(i32(n) - 2));
  return {index, inside - to_float(index)};
}

/// w: unit, local
template <class F>
HELIO_GPU_NOINLINE KERNEL AlbedoOf<F> albedo_at(const AnisotropicRowOf<F>& row, Vec3<F> w) {
  const F sine = sqrt(w.x * w.x + w.y * w.y);
  const F cos_phi = select(sine > 0, abs(w.x) / sine, F(0.5f));
  const auto a = place_at(aspect_place(row.aspect) * float(kAnisotropies - 1), kAnisotropies);
  const auto r =
      place_at(row.roughness * float(kAnisotropicRoughnesses - 1), kAnisotropicRoughnesses);
  const auto p = place_at(cos_phi * float(kAnisotropicPhis - 1), kAnisotropicPhis);
  const F alpha = sqr(row.roughness), along = alpha / row.aspect;
  const F seen = sqrt(sqr(along * cos_phi) + sqr(alpha * row.aspect) * (1 - sqr(cos_phi)));
  const F cosine = clamp01(w.z);
  const auto c =
      place_at(axis_place(cosine, seen) * float(kAnisotropicCosines - 1), kAnisotropicCosines);
  AlbedoOf<F> loss{F(0), F(0)};
  for (i32 corner = 0; corner < 16; ++corner) {
    const i32 da = corner & 1;
    const i32 dr = corner >> 1 & 1;
    const i32 dp = corner >> 2 & 1;
    const i32 dc = corner >> 3;
    const F weight = a.weight_of(da) * r.weight_of(dr) * p.weight_of(dp) * c.weight_of(dc);
    const IntOf<F> row_index = (a.index + da) * i32(kAnisotropicRoughnesses) + r.index + dr;
    const IntOf<F> at =
        ((row_index * i32(kAnisotropicPhis) + p.index + dp) * i32(kAnisotropicCosines) + c.index +
         dc) *
        2;
    loss.total += gather(kAnisotropicLoss, at) * weight;
    loss.schlick += gather(kAnisotropicLoss, at + 1) * weight;
  }
  const F scale = loss_scale(cosine, along);
  return {1 - loss.total * scale, schlick_weight(cosine) - loss.schlick * scale};
}
template <class F>
HELIO_GPU_NOINLINE KERNEL AlbedoOf<F> albedo_average(const AnisotropicRowOf<F>& row) {
  const auto a = place_at(aspect_place(row.aspect) * float(kAnisotropies - 1), kAnisotropies);
  const auto r =
      place_at(row.roughness * float(kAnisotropicRoughnesses - 1), kAnisotropicRoughnesses);
  AlbedoOf<F> loss{F(0), F(0)};
  for (i32 corner = 0; corner < 4; ++corner) {
    const i32 da = corner & 1;
    const i32 dr = corner >> 1;
    const F weight = a.weight_of(da) * r.weight_of(dr);
    const IntOf<F> at = ((a.index + da) * i32(kAnisotropicRoughnesses) + r.index + dr) * 2;
    loss.total += gather(kAnisotropicAverageLoss, at) * weight;
    loss.schlick += gather(kAnisotropicAverageLoss, at + 1) * weight;
  }
  const F scale = sqr(sqr(row.roughness));
  return {1 - loss.total * scale, kSchlickMean - loss.schlick * scale};
}

/// Shares of light that leave a rough interface after one scattering.
template <class F>
struct GlassAlbedoOf {
  F reflected;  // by facets at which it could refract too
  F totally;    // by the others
  F refracted;
  F kept;  // what refracts more if those facets reflect nothing
};
template <LaneMask M, class F>
KERNEL GlassAlbedoOf<F> select(M m, const GlassAlbedoOf<F>& a, const GlassAlbedoOf<F>& b) {
  return {select(m, a.reflected, b.reflected), select(m, a.totally, b.totally),
          select(m, a.refracted, b.refracted), select(m, a.kept, b.kept)};
}
/// Between the entries of a table with so many iors, roughnesses and cosines; places from 0 to 1.
template <class F>
HELIO_GPU_NOINLINE KERNEL GlassAlbedoOf<F> glass_between(const float* table, u32 iors,
                                                         u32 roughnesses, u32 cosines,
                                                         Vec3<F> places) {
  const auto i = place_at(places.x * float(iors - 1), iors);
  const auto j = place_at(places.y * float(roughnesses - 1), roughnesses);
  const auto k = place_at(places.z * float(cosines - 1), cosines);
  F sum[4]{F(0), F(0), F(0), F(0)};
  for (i32 corner = 0; corner < 8; ++corner) {
    const i32 dx = corner & 1;
    const i32 dy = corner >> 1 & 1;
    const i32 dz = corner >> 2;
    const F weight = i.weight_of(dx) * j.weight_of(dy) * k.weight_of(dz);
    const IntOf<F> row = (i.index + dx) * i32(roughnesses) + j.index + dy;
    const IntOf<F> at = (row * i32(cosines) + k.index + dz) * 4;
    const FourOf<F> entry = gather4(table, at);
    for (u32 n = 0; n < 4; ++n) sum[n] += entry.of[n] * weight;
  }
  return {sum[0], sum[1], sum[2], sum[3]};
}
/// eta   index of the far side over the near side's
template <class F>
KERNEL GlassAlbedoOf<F> glass_albedo(F cosine, F roughness, F eta) {
  const Vec3<F> places(ior_place(max2(eta, 1 / eta)), roughness,
                       glass_place(clamp01(cosine), sqr(roughness), eta));
  return either(
      eta > 1,
      [&] {
        return glass_between(kEnteringAlbedo, kEnteringIors, kEnteringRoughnesses, kEnteringCosines,
                             places);
      },
      [&] {
        return glass_between(kLeavingAlbedo, kLeavingIors, kLeavingRoughnesses, kLeavingCosines,
                             places);
      });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
