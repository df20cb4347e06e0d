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

struct Fresnel {
  float reflectance;
  float cos_t;  // of the refracted direction, > 0; 0: total internal reflection
};
/// Exact, unpolarised.
///
/// c     cosine of incidence, >= 0
/// eta   index of refraction of the far side over the near side's
KERNEL Fresnel fresnel_dielectric(float c, float eta) {
  const float eta2_sin2 = sqr(eta) - (1 - c * c);
  if (eta2_sin2 <= 0) return {1, 0};
  const float root = std::sqrt(eta2_sin2);  // eta * cos_t
  const float perpendicular = (c - root) / (c + root);
  const float parallel = (sqr(eta) * c - root) / (sqr(eta) * c + root);
  return {0.5f * (sqr(perpendicular) + sqr(parallel)), root / eta};
}

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
KERNEL float ggx_lambda(vec3 w, Ggx g) {
  return 0.5f * (std::sqrt(1 + ggx_slope2(g, w) / (w.z * w.z)) - 1);
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

/// Where a roughness lies among the rows of a table.
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
  const IntOf<F> i = row.row * 2;
  const F total = gather(kReflectionAverageLoss, i),
          schlick = gather(kReflectionAverageLoss, i + 1);
  const F scale = sqr(row.alpha);
  return {1 - (total + (gather(kReflectionAverageLoss, i + 2) - total) * row.weight) * scale,
          kSchlickMean -
              (schlick + (gather(kReflectionAverageLoss, i + 3) - schlick) * row.weight) * scale};
}
template <class F>
KERNEL AlbedoOf<F> albedo_at(const AlbedoRowOf<F>& row, F cosine) {
  const F c = clamp01(cosine);
  const F place = axis_place(c, row.alpha) * float(kAlbedoCosines - 1);
  const IntOf<F> column = min2(to_int(place), IntOf<F>(kAlbedoCosines - 2));
  const F w = place - to_float(column);
  const IntOf<F> first = (row.row * i32(kAlbedoCosines) + column) * 2;
  const IntOf<F> second = first + i32(2 * kAlbedoCosines);
  const auto between = [&](i32 k) {
    const F a = gather(kReflectionLoss, first + k);
    return a + (gather(kReflectionLoss, second + k) - a) * row.weight;
  };
  const F total = between(0), schlick = between(1), scale = loss_scale(c, row.alpha);
  return {1 - (total + (between(2) - total) * w) * scale,
          schlick_weight(c) - (schlick + (between(3) - schlick) * w) * scale};
}

/// A row of the tables for anisotropic microfacets.
struct AnisotropicRow {
  float roughness;
  float aspect;  // square root of alpha along y over alpha along x; 1: isotropic
};

/// Where a number lies between n entries of a table, x from 0 to n - 1.
struct Place {
  u32 index;
  float weight;  // of the next entry
};
KERNEL Place place_at(float x, u32 n) {
  const u32 index = min2(u32(max2(x, 0.0f)), n - 2);
  return {index, clamp01(x - float(index))};
}

/// w: unit, local
HELIO_GPU_NOINLINE KERNEL Albedo albedo_at(const AnisotropicRow& row, vec3 w) {
  const float sine = std::sqrt(w.x * w.x + w.y * w.y);
  const float cos_phi = sine > 0 ? std::fabs(w.x) / sine : 0.5f;
  const Place a = place_at(aspect_place(row.aspect) * (kAnisotropies - 1), kAnisotropies);
  const Place r = place_at(row.roughness * (kAnisotropicRoughnesses - 1), kAnisotropicRoughnesses);
  const Place p = place_at(cos_phi * (kAnisotropicPhis - 1), kAnisotropicPhis);
  const float alpha = sqr(row.roughness), along = alpha / row.aspect;
  const float seen = std::sqrt(sqr(along * cos_phi) + sqr(alpha * row.aspect) * (1 - sqr(cos_phi)));
  const float cosine = clamp01(w.z);
  const Place c =
      place_at(axis_place(cosine, seen) * (kAnisotropicCosines - 1), kAnisotropicCosines);
  Albedo loss{0, 0};
  for (u32 corner = 0; corner < 16; ++corner) {
    const u32 da = corner & 1;
    const u32 dr = corner >> 1 & 1;
    const u32 dp = corner >> 2 & 1;
    const u32 dc = corner >> 3;
    const float weight = (da ? a.weight : 1 - a.weight) * (dr ? r.weight : 1 - r.weight) *
                         (dp ? p.weight : 1 - p.weight) * (dc ? c.weight : 1 - c.weight);
    const u32 row_index = (a.index + da) * kAnisotropicRoughnesses + r.index + dr;
    const float* at =
        kAnisotropicLoss +
        2 * ((row_index * kAnisotropicPhis + p.index + dp) * kAnisotropicCosines + c.index + dc);
    loss.total += at[0] * weight;
    loss.schlick += at[1] * weight;
  }
  const float scale = loss_scale(cosine, along);
  return {1 - loss.total * scale, schlick_weight(cosine) - loss.schlick * scale};
}
HELIO_GPU_NOINLINE KERNEL Albedo albedo_average(const AnisotropicRow& row) {
  const Place a = place_at(aspect_place(row.aspect) * (kAnisotropies - 1), kAnisotropies);
  const Place r = place_at(row.roughness * (kAnisotropicRoughnesses - 1), kAnisotropicRoughnesses);
  Albedo loss{0, 0};
  for (u32 corner = 0; corner < 4; ++corner) {
    const u32 da = corner & 1;
    const u32 dr = corner >> 1;
    const float weight = (da ? a.weight : 1 - a.weight) * (dr ? r.weight : 1 - r.weight);
    const float* at =
        kAnisotropicAverageLoss + 2 * ((a.index + da) * kAnisotropicRoughnesses + r.index + dr);
    loss.total += at[0] * weight;
    loss.schlick += at[1] * weight;
  }
  const float scale = sqr(sqr(row.roughness));
  return {1 - loss.total * scale, kSchlickMean - loss.schlick * scale};
}

/// Shares of light that leave a rough interface after one scattering.
struct GlassAlbedo {
  float reflected;  // by facets at which it could refract too
  float totally;    // by the others
  float refracted;
  float kept;  // what refracts more if those facets reflect nothing
};
/// Between the entries of a table with so many iors, roughnesses and cosines; places from 0 to 1.
HELIO_GPU_NOINLINE KERNEL GlassAlbedo glass_between(const float* table, u32 iors, u32 roughnesses,
                                                    u32 cosines, vec3 places) {
  const Place i = place_at(places.x * float(iors - 1), iors);
  const Place j = place_at(places.y * float(roughnesses - 1), roughnesses);
  const Place k = place_at(places.z * float(cosines - 1), cosines);
  float sum[4]{};
  for (u32 corner = 0; corner < 8; ++corner) {
    const u32 dx = corner & 1;
    const u32 dy = corner >> 1 & 1;
    const u32 dz = corner >> 2;
    const float weight = (dx ? i.weight : 1 - i.weight) * (dy ? j.weight : 1 - j.weight) *
                         (dz ? k.weight : 1 - k.weight);
    const u32 row = (i.index + dx) * roughnesses + j.index + dy;
    const float* at = table + 4 * (row * cosines + k.index + dz);
    for (u32 n = 0; n < 4; ++n) sum[n] += at[n] * weight;
  }
  return {sum[0], sum[1], sum[2], sum[3]};
}
/// eta   index of the far side over the near side's
KERNEL GlassAlbedo glass_albedo(float cosine, float roughness, float eta) {
  const vec3 places(ior_place(max2(eta, 1 / eta)), roughness,
                    glass_place(clamp01(cosine), sqr(roughness), eta));
  return eta > 1 ? glass_between(kEnteringAlbedo, kEnteringIors, kEnteringRoughnesses,
                                 kEnteringCosines, places)
                 : glass_between(kLeavingAlbedo, kLeavingIors, kLeavingRoughnesses, kLeavingCosines,
                                 places);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
