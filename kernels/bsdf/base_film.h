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
HELIO_GPU_NOINLINE KERNEL Reflectances film_at(const Base& b, float c) {
  const FilmFace face = film_face(b.film, c);
  return {film_on_schlick(face, b.film_coat) * b.coat_f90, film_on_schlick(face, b.film_metal)};
}

/// Their averages by cosine.
HELIO_GPU_NOINLINE KERNEL Reflectances average_film(const Base& b) {
  // Gauss-Legendre with 4 points.
  const float places[4] = {0.06943184f, 0.33000948f, 0.66999052f, 0.93056816f};
  const float weights[4] = {0.17392742f, 0.32607258f, 0.32607258f, 0.17392742f};
  Reflectances sum;
  for (u32 i = 0; i < 4; ++i) add(sum, film_at(b, places[i]), 2 * places[i] * weights[i]);
  return sum;
}

/// Calls with some of the microfacets that wo sees: wo, a normal, and its share of all.
///
/// Gauss-Legendre with 8 points over the height of the spherical cap from which sample_ggx() takes
/// them, and 8 evenly around. What is isotropic is the same on both sides of wo: half a turn is
/// all.
template <class Visit>
KERNEL void see_facets(const Base& b, const Visit& visit) {
  if (b.delta) return visit(b.wo, vec3(0, 0, 1), 1.0f);
  const float places[8] = {0.01985507f, 0.10166676f, 0.23723380f, 0.40828268f,
                           0.59171732f, 0.76276620f, 0.89833324f, 0.98014493f};
  const float weights[8] = {0.05061427f, 0.11119052f, 0.15685332f, 0.18134189f,
                            0.18134189f, 0.15685332f, 0.11119052f, 0.05061427f};
  const bool stretched = is_stretched(b);
  const vec3 wo = stretched ? b.wo : vec3(safe_sqrt(1 - sqr(b.wo.z)), 0, b.wo.z);
  const float step = stretched ? 0.125f : 0.0625f;
  for (u32 i = 0; i < 8; ++i) {
    const float first = stretched && i % 2 == 0 ? 0 : 0.5f;
    for (u32 j = 0; j < 8; ++j) {
      const vec2 u((float(j) + first) * step, places[i]);
      visit(wo, sample_ggx(wo, b.facets, u), 0.125f * weights[i]);
    }
  }
}
/// Share of the light between wo and wi that no other microfacet holds up, of what wo sees.
KERNEL float open_to(const Base& b, vec3 wi) {
  if (b.delta) return 1;
  const float out = 1 + ggx_lambda(b.wo, b.facets);
  return out / (out + ggx_lambda(wi, b.facets));
}

/// Averages of the film over the light that leaves to wo.
HELIO_GPU_NOINLINE KERNEL Reflectances seen_film(const Base& b) {
  Reflectances sum;
  float all = 1e-6f;
  see_facets(b, [&](vec3 wo, vec3 h, float weight) {
    const float c = max2(dot(wo, h), 0.0f);
    const vec3 wi = h * (2 * c) - wo;
    const float open = wi.z > 0 ? open_to(b, wi) * weight : 0;
    add(sum, film_at(b, c), open);
    all += open;
  });
  return {sum.coat / all, sum.metal / all};
}

/// Reflectance of the interface of glass at cosine c, where it is `bare` without the film.
KERNEL vec3 glass_at(const Base& b, float c, float bare) {
  if (!has_film(b.glass_film)) return vec3(bare);
  const vec3 film = film_on_dielectric(b.glass_film, c, b.eta);
  return vec3(bare) + (film - vec3(bare)) * b.glass_film.weight;
}

/// What the film adds to the reflectance of the interface, on average over what wo sees.
struct FilmOnFace {
  vec3 whole{0};
  vec3 reflected{0};  // of light that is reflected, by facets at which it could refract
  vec3 refracted{0};  // of light that refracts: lost
};
HELIO_GPU_NOINLINE KERNEL FilmOnFace film_on_face(const Base& b) {
  FilmOnFace sum;
  see_facets(b, [&](vec3 wo, vec3 h, float weight) {
    const float c = max2(dot(wo, h), 0.0f);
    const Fresnel bare = fresnel_dielectric(c, b.eta);
    const vec3 added = (glass_at(b, c, bare.reflectance) - vec3(bare.reflectance)) * weight;
    sum.whole += added;
    if (!(bare.cos_t > 0)) return;
    const vec3 up = h * (2 * c) - wo;
    const vec3 down = h * (c / b.eta - bare.cos_t) - wo * (1 / b.eta);
    if (up.z > 0) sum.reflected += added * open_to(b, up);
    if (down.z < 0) sum.refracted += added * open_to(b, down);
  });
  return sum;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
