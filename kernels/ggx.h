// Fresnel equations, the isotropic GGX distribution of microfacets and its albedos. Local frames:
// z is the shading normal and wo.z > 0. Called by bsdf.h.
#pragma once

#include "kernels/ggx_tables.h"
#include "kernels/math.h"
#include "kernels/warp.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// (1 - c)^5 of Schlick 1994, "An Inexpensive BRDF Model for Physically-based Rendering".
KERNEL float schlick_weight(float c) {
  const float m = 1 - clamp01(c);
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

/// Smith's Lambda. cos2: squared cosine to the normal, > 0.
///
/// Source: Heitz 2014, "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs",
/// JCGT 3(2), section 5.3.
KERNEL float ggx_lambda(float cos2, float alpha2) {
  return 0.5f * (std::sqrt(1 + alpha2 * max2(1 - cos2, 0.0f) / cos2) - 1);
}

/// Density of normals D(h), unit h.
KERNEL float ggx_density(vec3 h, float alpha2) {
  return alpha2 / (kPi * sqr(h.x * h.x + h.y * h.y + alpha2 * h.z * h.z));
}

/// D(h) G1(wo) / wo.z: times |wo.h| it is the density of visible normals.
KERNEL float ggx_visible_density(vec3 wo, float density, float alpha2) {
  return 2 * density / (wo.z + std::sqrt(alpha2 + (1 - alpha2) * wo.z * wo.z));
}

/// D(h) G2(wo, wi) / (4 wo.z wi.z), with heights correlated (Heitz 2014, section 5.4).
KERNEL float ggx_reflection(vec3 wo, vec3 wi, float density, float alpha2) {
  const float a = wi.z * std::sqrt(alpha2 + (1 - alpha2) * wo.z * wo.z);
  const float b = wo.z * std::sqrt(alpha2 + (1 - alpha2) * wi.z * wi.z);
  return 0.5f * density / (a + b);
}

/// A normal visible from wo; density D(h) G1(wo) |wo.h| / wo.z.
///
/// Source: Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps", CGF 42(8).
/// Tested: tests/unit/bsdf_test.cpp.
KERNEL vec3 sample_ggx(vec3 wo, float alpha, vec2 u) {
  const vec3 w = normalize(vec3(wo.x * alpha, wo.y * alpha, wo.z));
  const float z = (1 - u.y) * (1 + w.z) - w.z;
  const float r = safe_sqrt(1 - z * z);
  const SinCos phi = sincos_turns(u.x);
  const vec3 h = vec3(r * phi.cos, r * phi.sin, z) + w;
  return normalize(vec3(h.x * alpha, h.y * alpha, max2(h.z, 1e-7f)));
}

/// Where a roughness and an albedo lie in the tables.
struct AlbedoRow {
  const float* first;
  const float* second;
  float weight;
};
/// Share of light that single scattering reflects with Fresnel 1, and the same weighted by Schlick.
struct Albedo {
  float total;
  float schlick;
};

KERNEL AlbedoRow albedo_row(const float* table, u32 stride, float roughness) {
  const float place = clamp01(roughness) * (kAlbedoRoughnesses - 1);
  const u32 row = min2(u32(place), kAlbedoRoughnesses - 2);
  return {table + row * stride, table + (row + 1) * stride, place - float(row)};
}
KERNEL Albedo albedo_average(float roughness) {
  const AlbedoRow row = albedo_row(kReflectionAverage, 2, roughness);
  return {row.first[0] + (row.second[0] - row.first[0]) * row.weight,
          row.first[1] + (row.second[1] - row.first[1]) * row.weight};
}
KERNEL Albedo albedo_at(const AlbedoRow& row, float cosine) {
  const float place = std::sqrt(clamp01(cosine)) * (kAlbedoCosines - 1);
  const u32 column = min2(u32(place), kAlbedoCosines - 2);
  const float w = place - float(column);
  const float* a = row.first + 2 * column;
  const float* b = row.second + 2 * column;
  const float total_a = a[0] + (a[2] - a[0]) * w;
  const float total_b = b[0] + (b[2] - b[0]) * w;
  const float schlick_a = a[1] + (a[3] - a[1]) * w;
  const float schlick_b = b[1] + (b[3] - b[1]) * w;
  return {total_a + (total_b - total_a) * row.weight,
          schlick_a + (schlick_b - schlick_a) * row.weight};
}

/// Share of light that leaves a rough interface after one scattering, reflected or refracted.
///
/// eta   index of the far side over the near side's
KERNEL float glass_albedo(float cosine, float roughness, float eta) {
  const float ior = max2(eta, 1 / eta);
  const float x = std::sqrt((ior - 1) / (ior + 1)) * (1.29099445f * (kGlassIors - 1));
  const float y = clamp01(roughness) * (kGlassRoughnesses - 1);
  const float z = std::sqrt(clamp01(cosine)) * (kGlassCosines - 1);
  const u32 i = min2(u32(x), kGlassIors - 2);
  const u32 j = min2(u32(y), kGlassRoughnesses - 2);
  const u32 k = min2(u32(z), kGlassCosines - 2);
  const float fx = min2(x - float(i), 1.0f);
  const float fy = y - float(j);
  const float fz = z - float(k);
  float sum = 0;
  for (u32 corner = 0; corner < 8; ++corner) {
    const u32 dx = corner & 1;
    const u32 dy = corner >> 1 & 1;
    const u32 dz = corner >> 2;
    const u32 side = eta > 1 ? 0 : 1;
    const u32 at = (((i + dx) * 2 + side) * kGlassRoughnesses + j + dy) * kGlassCosines + k + dz;
    sum += kGlassAlbedo[at] * (dx ? fx : 1 - fx) * (dy ? fy : 1 - fy) * (dz ? fz : 1 - fz);
  }
  return sum;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
