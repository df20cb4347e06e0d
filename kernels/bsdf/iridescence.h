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
struct Amplitude {
  float s, p;
  float cos_t;  // of the refracted direction; 0: total internal reflection
};
/// c, eta   as of fresnel_dielectric()
KERNEL Amplitude amplitude_of(float c, float eta) {
  const float eta2 = sqr(eta);
  const float eta2_sin2 = eta2 - (1 - c * c);
  if (eta2_sin2 <= 0) return {1, 1, 0};
  const float root = std::sqrt(eta2_sin2);
  return {(c - root) / (c + root), (root - eta2 * c) / (root + eta2 * c), root / eta};
}

/// Orders of interference that count. What is left out is below 0.02 on average, 0.1 at worst.
inline constexpr u32 kFringeOrders = 3;

/// Means of the cosine of once, twice, ... the phase, by colour.
struct Fringes {
  vec3 order[kFringeOrders];
};

/// Light that has gone `way` metres further.
///
/// The eye's sensitivities are Gaussians over the wave number, those of the paper's supplement: two
/// for X, one for Y and for Z. Constant spectra become white.
KERNEL Fringes fringes_of(float way) {
  const float centers[4] = {1.6810e6f, 2.2399e6f, 1.7953e6f, 2.2084e6f};    // 1/m
  const float variances[4] = {4.3278e9f, 4.5282e9f, 9.3046e9f, 6.6121e9f};  // 1/m^2
  const vec3 colors[4] = {
      vec3(2.6062643f, -0.7795706f, 0.0447534f), vec3(0.4736903f, -0.1416875f, 0.0081340f),
      vec3(-1.5371385f, 1.8760108f, -0.2040259f), vec3(-0.5428160f, 0.0452474f, 1.1511385f)};
  Fringes f{{vec3(0), vec3(0), vec3(0)}};
  for (u32 i = 0; i < 4; ++i) {
    const float wave = sincos_turns(centers[i] * way).cos;
    const float left = std::exp(-variances[i] * sqr(2 * kPi * way));
    const float left3 = left * left * left;
    f.order[0] += colors[i] * (left * wave);
    f.order[1] += colors[i] * (left * left3 * (2 * wave * wave - 1));
    f.order[2] += colors[i] * (left3 * left3 * left3 * (4 * wave * wave - 3) * wave);
  }
  return f;
}

/// A film between two media. Indices are over that of the side which light comes from.
struct ThinFilm {
  float weight;  // 0: none
  float ior;
  float way;  // metres that light goes in the film and back, times its index, at normal incidence
};

/// The film on a microfacet: all but what lies below.
struct FilmFace {
  Amplitude outer;
  Fringes fringes;
};
/// c   cosine of incidence, >= 0
KERNEL FilmFace film_face(const ThinFilm& film, float c) {
  const Amplitude outer = amplitude_of(c, film.ior);
  return {outer, fringes_of(film.way * outer.cos_t)};
}

/// Share of one polarisation that a film reflects: a geometric sum over the bounces in it, in which
/// amplitudes interfere.
KERNEL vec3 reflect_film(float outer, vec3 inner, const Fringes& fringes) {
  const float reflected = sqr(outer);
  const float entering = 1 - reflected;
  const vec3 below = inner * inner;
  const vec3 returned =
      below * (entering * entering) / glm::max(vec3(1) - below * reflected, vec3(1e-7f));
  const vec3 bounce = inner * -outer;
  const vec3 sum =
      bounce * (fringes.order[0] + bounce * (fringes.order[1] + bounce * fringes.order[2]));
  return vec3(reflected) + returned + (returned - vec3(entering)) * sum * 2.0f;
}

/// Reflectance of a film on something with amplitudes `s` and `p`.
KERNEL vec3 reflect_film(const FilmFace& face, vec3 s, vec3 p) {
  const vec3 sum =
      reflect_film(face.outer.s, s, face.fringes) + reflect_film(face.outer.p, p, face.fringes);
  return glm::clamp(sum * 0.5f, vec3(0), vec3(1));
}

/// Reflectance of a film on an interface of index eta.
///
/// c, eta   as of fresnel_dielectric()
HELIO_GPU_NOINLINE KERNEL vec3 film_on_dielectric(const ThinFilm& film, float c, float eta) {
  const FilmFace face = film_face(film, c);
  if (!(face.outer.cos_t > 0)) return vec3(1);
  const Amplitude inner = amplitude_of(face.outer.cos_t, eta / film.ior);
  return inner.cos_t > 0 ? reflect_film(face, vec3(inner.s), vec3(inner.p)) : vec3(1);
}

/// Amplitude at normal incidence that something of reflectance f0 has below a film.
KERNEL vec3 amplitude_below(const ThinFilm& film, vec3 f0) {
  const vec3 a(std::sqrt(f0.x), std::sqrt(f0.y), std::sqrt(f0.z));
  const vec3 film_side = (vec3(1) - a) * film.ior;
  const vec3 base_side = vec3(1) + a;
  return (film_side - base_side) / (film_side + base_side);
}

/// Reflectance of a film on something whose Fresnel is Schlick's.
///
/// inner   amplitude_below()
KERNEL vec3 film_on_schlick(const FilmFace& face, vec3 inner) {
  const float weight = schlick_weight(face.outer.cos_t);
  const auto at_cosine = [weight](float a) {
    return std::copysign(std::sqrt(a * a + (1 - a * a) * weight), a);
  };
  const vec3 a(at_cosine(inner.x), at_cosine(inner.y), at_cosine(inner.z));
  return reflect_film(face, a, a);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
