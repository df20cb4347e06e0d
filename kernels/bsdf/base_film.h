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
template <class F>
KERNEL void add(ReflectancesOf<F>& sum, const ReflectancesOf<F>& r, F weight) {
  sum.coat += r.coat * weight;
  sum.metal += r.metal * weight;
}

/// Reflectances of the film at cosine c.
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL ReflectancesOf<F> film_at(const BaseOf<F, S>& b, F c) {
  const FilmFaceOf<F> face = film_face(b.film, c);
  return {film_on_schlick(face, b.film_coat) * b.coat_f90, film_on_schlick(face, b.film_metal)};
}

/// Their averages by cosine.
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL ReflectancesOf<F> average_film(const BaseOf<F, S>& b) {
  // Gauss-Legendre with 4 points.
  const float places[4] = {0.06943184f, 0.33000948f, 0.66999052f, 0.93056816f};
  const float weights[4] = {0.17392742f, 0.32607258f, 0.32607258f, 0.17392742f};
  ReflectancesOf<F> sum;
  for (u32 i = 0; i < 4; ++i) add(sum, film_at(b, F(places[i])), F(2 * places[i] * weights[i]));
  return sum;
}

/// Calls with some of the microfacets that wo sees: wo, a normal, and its share of all.
///
/// Gauss-Legendre with 8 points over the height of the spherical cap from which sample_ggx() takes
/// them, and 8 evenly around. What is isotropic is the same on both sides of wo: half a turn is
/// all.
template <class F, Features S, class Visit>
KERNEL void see_facets(const BaseOf<F, S>& b, const Visit& visit) {
  if (any(is_mirror(b))) visit(b.wo, Vec3<F>(0, 0, 1), select(is_mirror(b), F(1), F(0)));
  if (all(is_mirror(b))) return;
  const float places[8] = {0.01985507f, 0.10166676f, 0.23723380f, 0.40828268f,
                           0.59171732f, 0.76276620f, 0.89833324f, 0.98014493f};
  const float weights[8] = {0.05061427f, 0.11119052f, 0.15685332f, 0.18134189f,
                            0.18134189f, 0.15685332f, 0.11119052f, 0.05061427f};
  const BoolOf<F> stretched = is_stretched(b);
  const Vec3<F> wo = select(stretched, b.wo, Vec3<F>(safe_sqrt(1 - sqr(b.wo.z)), F(0), b.wo.z));
  const F step = select(stretched, F(0.125f), F(0.0625f));
  for (u32 i = 0; i < 8; ++i) {
    const F first = i % 2 == 0 ? select(stretched, F(0), F(0.5f)) : F(0.5f);
    for (u32 j = 0; j < 8; ++j) {
      const Vec2<F> u((float(j) + first) * step, F(places[i]));
      visit(wo, sample_ggx(wo, b.facets, u), select(is_mirror(b), F(0), F(0.125f * weights[i])));
    }
  }
}
/// Share of the light between wo and wi that no other microfacet holds up, of what wo sees.
template <class F, Features S>
KERNEL F open_to(const BaseOf<F, S>& b, Vec3<F> wi) {
  const F out = 1 + ggx_lambda(b.wo, b.facets);
  return select(is_mirror(b), F(1), out / (out + ggx_lambda(wi, b.facets)));
}

/// Averages of the film over the light that leaves to wo.
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL ReflectancesOf<F> seen_film(const BaseOf<F, S>& b) {
  ReflectancesOf<F> sum;
  F seen = 1e-6f;
  see_facets(b, [&](Vec3<F> wo, Vec3<F> h, F weight) {
    const F c = max2(dot(wo, h), F(0));
    const Vec3<F> wi = h * (2 * c) - wo;
    const F open = select(wi.z > 0, open_to(b, wi) * weight, F(0));
    add(sum, film_at(b, c), open);
    seen += open;
  });
  return {sum.coat / seen, sum.metal / seen};
}

/// Reflectance of the interface of glass at cosine c, where it is `bare` without the film.
template <class F, Features S>
KERNEL Vec3<F> glass_at(const BaseOf<F, S>& b, F c, F bare) {
  return either(
      has_film<S>(b.glass_film),
      [&] {
        const Vec3<F> film = film_on_dielectric(b.glass_film, c, b.eta);
        return Vec3<F>(bare) + (film - Vec3<F>(bare)) * b.glass_film.weight;
      },
      [&] { return Vec3<F>(bare); });
}

/// Reflectance that the film adds to the interface's, on average over what wo sees.
template <class F>
struct FilmOnFaceOf {
  Vec3<F> whole{0};
  Vec3<F> reflected{0};  // of light that is reflected, by facets at which it could refract
  Vec3<F> refracted{0};  // of light that refracts: lost
};
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL FilmOnFaceOf<F> film_on_face(const BaseOf<F, S>& b) {
  FilmOnFaceOf<F> sum;
  const Vec3<F> none(0);
  see_facets(b, [&](Vec3<F> wo, Vec3<F> h, F weight) {
    const F c = max2(dot(wo, h), F(0));
    const FresnelOf<F> bare = fresnel_dielectric(c, b.eta);
    const Vec3<F> added = (glass_at(b, c, bare.reflectance) - Vec3<F>(bare.reflectance)) * weight;
    sum.whole += added;
    const BoolOf<F> passes = bare.cos_t > 0;
    if (!any(passes)) return;
    const Vec3<F> up = h * (2 * c) - wo;
    const Vec3<F> down = h * (c / b.eta - bare.cos_t) - wo * (1 / b.eta);
    sum.reflected += select(passes & (up.z > 0), added * open_to(b, up), none);
    sum.refracted += select(passes & (down.z < 0), added * open_to(b, down), none);
  });
  return sum;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
