// Iridescence: what light adds up to that both faces of a thin film reflect, by colour. Called by
// base.h.
//
// Source: Belcour and Barla 2017, "A Practical Extension to Microfacet Theory for the Modeling of
// Varying Iridescence", sections 3 and 4; glTF's KHR_materials_iridescence. Unlike there, each
// polarisation has its own amplitudes, and white films are white in Rec.709.
#pragma once

#include "kernels/bsdf/ggx.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Reflected over incoming amplitude; both polarisations have the same sign at normal incidence.
template <class F>
struct AmplitudeOf {
  F s, p;
  F cos_t;  // of the refracted direction; 0: total internal reflection
};
/// c, eta   as of fresnel_dielectric()
template <class F>
KERNEL AmplitudeOf<F> amplitude_of(F c, F eta) {
  const F eta2 = sqr(eta);
  const F eta2_sin2 = eta2 - (1 - c * c);
  const BoolOf<F> total = eta2_sin2 <= 0;
  if (all(total)) return {F(1), F(1), F(0)};
  const F root = sqrt(eta2_sin2);
  return {select(total, F(1), (c - root) / (c + root)),
          select(total, F(1), (root - eta2 * c) / (root + eta2 * c)),
          select(total, F(0), root / eta)};
}

/// Orders of interference that count. What is left out is below 0.02 on average, 0.1 at worst.
inline constexpr u32 kFringeOrders = 3;

/// Means of the cosine of once, twice, ... the phase, by colour.
template <class F>
struct FringesOf {
  Vec3<F> order[kFringeOrders];
};

/// Light that has gone `way` metres further.
///
/// The eye's sensitivities are Gaussians over the wave number, those of the paper's supplement: two
/// for X, one for Y and for Z. Constant spectra become white.
template <class F>
KERNEL FringesOf<F> fringes_of(F way) {
  const float centers[4] = {1.6810e6f, 2.2399e6f, 1.7953e6f, 2.2084e6f};    // 1/m
  const float variances[4] = {4.3278e9f, 4.5282e9f, 9.3046e9f, 6.6121e9f};  // 1/m^2
  const vec3 colors[4] = {
      vec3(2.6062643f, -0.7795706f, 0.0447534f), vec3(0.4736903f, -0.1416875f, 0.0081340f),
      vec3(-1.5371385f, 1.8760108f, -0.2040259f), vec3(-0.5428160f, 0.0452474f, 1.1511385f)};
  FringesOf<F> f{{Vec3<F>(0), Vec3<F>(0), Vec3<F>(0)}};
  for (u32 i = 0; i < 4; ++i) {
    const Vec3<F> color(colors[i]);
    const F wave = sincos_turns(centers[i] * way).cos;
    const F left = exp(-variances[i] * sqr(2 * kPi * way));
    const F left3 = left * left * left;
    f.order[0] += color * (left * wave);
    f.order[1] += color * (left * left3 * (2 * wave * wave - 1));
    f.order[2] += color * (left3 * left3 * left3 * (4 * wave * wave - 3) * wave);
  }
  return f;
}

/// A film between two media. Indices are over that of the side which light comes from.
template <class F>
struct ThinFilmOf {
  F weight;  // 0: none
  F ior;
  F way;  // metres that light goes in the film and back, times its index, at normal incidence
};
using ThinFilm = ThinFilmOf<float>;

/// The film on a microfacet: all but what lies below.
template <class F>
struct FilmFaceOf {
  AmplitudeOf<F> outer;
  FringesOf<F> fringes;
};
/// c   cosine of incidence, >= 0
template <class F>
KERNEL FilmFaceOf<F> film_face(const ThinFilmOf<F>& film, F c) {
  const AmplitudeOf<F> outer = amplitude_of(c, film.ior);
  return {outer, fringes_of(film.way * outer.cos_t)};
}

/// Share of one polarisation that a film reflects: a geometric sum over the bounces in it, in which
/// amplitudes interfere.
template <class F>
KERNEL Vec3<F> reflect_film(F outer, Vec3<F> inner, const FringesOf<F>& fringes) {
  const F reflected = sqr(outer);
  const F entering = 1 - reflected;
  const Vec3<F> below = inner * inner;
  const Vec3<F> returned =
      below * (entering * entering) / max3(Vec3<F>(1) - below * reflected, Vec3<F>(1e-7f));
  const Vec3<F> bounce = inner * -outer;
  const Vec3<F> sum =
      bounce * (fringes.order[0] + bounce * (fringes.order[1] + bounce * fringes.order[2]));
  return Vec3<F>(reflected) + returned + (returned - Vec3<F>(entering)) * sum * F(2);
}

/// Reflectance of a film on something with amplitudes `s` and `p`.
template <class F>
KERNEL Vec3<F> reflect_film(const FilmFaceOf<F>& face, Vec3<F> s, Vec3<F> p) {
  const Vec3<F> sum =
      reflect_film(face.outer.s, s, face.fringes) + reflect_film(face.outer.p, p, face.fringes);
  return min3(max3(sum * F(0.5f), Vec3<F>(0)), Vec3<F>(1));
}

/// Reflectance of a film on an interface of index eta.
///
/// c, eta   as of fresnel_dielectric()
template <class F>
HELIO_GPU_NOINLINE KERNEL Vec3<F> film_on_dielectric(const ThinFilmOf<F>& film, F c, F eta) {
  const FilmFaceOf<F> face = film_face(film, c);
  const AmplitudeOf<F> inner = amplitude_of(face.outer.cos_t, F(eta / film.ior));
  return either((face.outer.cos_t > 0) & (inner.cos_t > 0),
                [&] { return reflect_film(face, Vec3<F>(inner.s), Vec3<F>(inner.p)); },
                [&] { return Vec3<F>(1); });
}

KERNEL vec3 film_on_dielectric(const ThinFilm& film, float c, float eta) {
  return film_on_dielectric<float>(film, c, eta);
}

/// Amplitude at normal incidence that something of reflectance f0 has below a film.
template <class F>
KERNEL Vec3<F> amplitude_below(const ThinFilmOf<F>& film, Vec3<F> f0) {
  const Vec3<F> a = sqrt3(f0);
  const Vec3<F> film_side = (Vec3<F>(1) - a) * film.ior;
  const Vec3<F> base_side = Vec3<F>(1) + a;
  return (film_side - base_side) / (film_side + base_side);
}

/// Reflectance of a film on something whose Fresnel is Schlick's.
///
/// inner   amplitude_below()
template <class F>
KERNEL Vec3<F> film_on_schlick(const FilmFaceOf<F>& face, Vec3<F> inner) {
  const F weight = schlick_weight(face.outer.cos_t);
  const auto at_cosine = [weight](F a) {
    return copysign(F(sqrt(a * a + (1 - a * a) * weight)), a);
  };
  const Vec3<F> a(at_cosine(inner.x), at_cosine(inner.y), at_cosine(inner.z));
  return reflect_film(face, a, a);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
