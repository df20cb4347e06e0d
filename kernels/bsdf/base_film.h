// A thin film on the base of the material: what it reflects, and on average over microfacets.
// Called by base_weights.h and base_lobes.h.
#pragma once

#include "kernels/bsdf/base.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Reflectances of coat and metal, by themselves.
template <class F>
struct ReflectancesOf {
  Vec3<F> coat{0};
  Vec3<F> metal{0};
};
using Reflectances = ReflectancesOf<float>;
KERNEL void add(Reflectances& sum, const Reflectances& r, float weight) {
  sum.coat += r.coat * weight;
  sum.metal += r.metal * weight;
}
/// Those below a film give way to those of the film.
KERNEL void cover(Reflectances& r, const Base& b, const Reflectances& film) {
  r.coat += (film.coat - r.coat) * b.film.weight;
  r.metal += (film.metal - r.metal) * b.film.weight;
}

/// Reflectances of the film at cosine c.
HELIO_CALL KERNEL Reflectances film_at(const Base& b, float c) {
  const FilmFace face = film_face(b.film, c);
  return {film_on_schlick(face, b.film_coat) * b.coat_f90, film_on_schlick(face, b.film_metal)};
}

/// Their averages by cosine.
HELIO_CALL KERNEL Reflectances average_film(const Base& b) {
  // Gauss-Legendre with 4 points.
  const float places[4] = {0.06943184f, 0.33000948f, 0.66999052f, 0.93056816f};
  const float weights[4] = {0.17392742f, 0.32607258f, 0.32607258f, 0.17392742f};
  Reflectances sum;
  for (u32 i = 0; i < 4; ++i) add(sum, film_at(b, places[i]), 2 * places[i] * weights[i]);
  return sum;
}

/// Some of the microfacets that wo sees, as often as it sees them: their cosines to wo, and shares
/// of the light that they reflect to it which no other one holds up.
inline constexpr u32 kSeenFacets = 8;
struct SeenFacets {
  u32 count;
  float cosine[kSeenFacets];
  float open[kSeenFacets];
};
KERNEL SeenFacets see_facets(const Base& b) {
  if (b.delta) return {1, {b.wo.z}, {1}};
  SeenFacets seen;
  seen.count = kSeenFacets;
  const float out = 1 + ggx_lambda(b.wo, b.facets);
  for (u32 i = 0; i < kSeenFacets; ++i) {
    const u32 reversed = (i & 1) << 2 | (i & 2) | i >> 2;
    const vec2 u = (vec2(float(i), float(reversed)) + 0.5f) / float(kSeenFacets);
    const vec3 h = sample_ggx(b.wo, b.facets, u);
    seen.cosine[i] = max2(dot(b.wo, h), 0.0f);
    const vec3 wi = h * (2 * seen.cosine[i]) - b.wo;
    seen.open[i] = wi.z > 0 ? out / (out + ggx_lambda(wi, b.facets)) : 0;
  }
  return seen;
}

/// Averages of the film over the light that leaves to wo.
HELIO_CALL KERNEL Reflectances seen_film(const Base& b) {
  const SeenFacets seen = see_facets(b);
  Reflectances sum;
  float open = 1e-6f;
  for (u32 i = 0; i < seen.count; ++i) {
    add(sum, film_at(b, seen.cosine[i]), seen.open[i]);
    open += seen.open[i];
  }
  return {sum.coat / open, sum.metal / open};
}

/// Reflectance of the interface of glass at cosine c, where it is `bare` without the film.
KERNEL vec3 glass_at(const Base& b, float c, float bare) {
  if (!has_film(b.glass_film)) return vec3(bare);
  const vec3 film = film_on_dielectric(b.glass_film, c, b.eta);
  return vec3(bare) + (film - vec3(bare)) * b.glass_film.weight;
}

/// What the film adds to the reflectance of the interface, on average over what wo sees.
HELIO_CALL KERNEL vec3 film_on_face(const Base& b) {
  const SeenFacets seen = see_facets(b);
  vec3 sum(0);
  for (u32 i = 0; i < seen.count; ++i) {
    const float bare = fresnel_dielectric(seen.cosine[i], b.eta).reflectance;
    sum += glass_at(b, seen.cosine[i], bare) - vec3(bare);
  }
  return sum / float(seen.count);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
