// The base of the material: its lobes. Local frames: z is the shading normal and wo.z > 0. Set by
// base_weights.h, evaluated by base_lobes.h.
#pragma once

#include "kernels/bsdf/iridescence.h"
#include "kernels/geometry/surface.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Microfacets with less than this alpha are a perfect mirror.
inline constexpr float kDeltaAlpha = 1e-3f;

/// How light passes the interface of a transmitting material.
enum class Interface : u8 {
  kNone,
  kJoint,  // each microfacet reflects or refracts
  kSplit,  // refraction has a roughness of its own, or the reflection is stretched
  kSheet,  // thin-walled: straight on, through both faces
};

/// The opaque lobes of a base, of microfacets that are no perfect mirrors. They show on both sides
/// of the surface.
template <class F>
struct OpaqueBase {
  FrameOf<F> frame;  // z: shading normal on wo's side
  Vec3<F> ng;        // geometric normal on wo's side
  Vec3<F> wo;        // local
  Vec3<F> diffuse;   // 1/sr, but for the factor 1 - coat albedo of wi
  Vec3<F> multiple;  // 1/sr, but for the factor 1 - albedo of wi
  Vec3<F> f0;        // Schlick's Fresnel of coat and metal together
  F f90;
  F coat_f0, coat_f90, coat_multiple;  // of the coat alone, in full
  F average_entering;                  // average over wi of 1 - coat albedo, layers included
  AlbedoRowOf<F> albedo;
  GgxOf<F> facets;
  F diffuse_probability;  // of sampling by cosine
  F facet_probability;    // of sampling a microfacet
};

/// A sum of
///   diffuse   Lambert under the coat, scaled by what the coat lets in and out
///   inside    what enters the coat, travels inside the body and leaves elsewhere (subsurface.h)
///   facets    GGX reflection of coat, metal and glass, Fresnel after Schlick or exact, and the
///             light that microfacets scatter more than once
///   through   what passes to the other side; its probability is what the others leave
struct Base : OpaqueBase<float> {
  float plastic, metallic;     // weights of coat and metal
  ThinFilm film;               // on both
  vec3 film_coat, film_metal;  // amplitude_below() it; set where there is one
  AnisotropicRow anisotropic;  // in place of `albedo`, where the aspect is not 1
  vec3 glass_tint;             // of light that passes
  vec3 glass_specular;         // scales the exact Fresnel reflectance
  vec3 glass_reflectance;      // where what passes is a lobe of its own: constant over microfacets
  float glass;                 // weight of the interface; 0: none
  vec3 glass_scale;            // makes up for light that a rough interface scatters more than once
  float through_scale;         // the same of what passes by itself
  ThinFilm glass_film;         // on the interface
  float eta;                   // index of the far side over that of wo's side
  Ggx through;
  float subsurface_probability;  // of light that travels inside the body
  float subsurface;              // share of light that does
  float reflectance;             // about the share of light that all of it gives off
  Interface interface;
  bool coated;         // what is sampled by cosine depends on the albedo of wi
  bool delta;          // the microfacets are perfect mirrors
  bool through_delta;  // and so is what passes, where it has a roughness of its own
};

/// The normal turned towards ng just as far as a mirror direction needs to leave the surface.
///
/// Source: Cycles 4, ensure_valid_specular_reflection(), which solves dot(reflected, ng) =
/// threshold. ng, ns, wo are unit; wo lies in the hemisphere of ng.
KERNEL vec3 bend_normal(vec3 ng, vec3 wo, vec3 ns) {
  const float cos_ng = dot(wo, ng);
  const float threshold = min2(0.9f * cos_ng, 0.01f);
  const float cos_ns = dot(ns, wo);
  if (2 * cos_ns * dot(ns, ng) - cos_ng >= threshold && cos_ns > 0) return ns;
  const vec3 x = normalize_or(ns - ng * dot(ns, ng), make_frame(ng).s);
  const float wx = dot(wo, x);
  const float a = max2(wx * wx + cos_ng * cos_ng, 1e-12f);
  const float b = 2 * (a + cos_ng * threshold);
  const float c = sqr(threshold + cos_ng);
  const float root = safe_sqrt(b * b - 4 * a * c);
  const float nz2 = clamp01(0.25f * (wx < 0 ? b + root : b - root) / a);
  return normalize(x * safe_sqrt(1 - nz2) + ng * std::sqrt(nz2));
}

/// A frame about n whose s lies along t as far as it can; t zero: anywhere.
KERNEL Frame make_frame(vec3 n, vec3 t) {
  const vec3 s = t - n * dot(n, t);
  const float length2 = dot(s, s);
  if (!(length2 > 1e-12f)) return make_frame(n);
  const vec3 unit = s * (1 / std::sqrt(length2));
  return {unit, cross(n, unit), n};
}

/// Colour of light that leaves rough microfacets after more than one scattering, per unit of energy
/// that single scattering loses; f_avg is the Fresnel reflectance averaged by cosine.
///
/// Source: Kulla and Conty 2017, "Revisiting Physically Based Shading at Imageworks".
template <class F>
KERNEL Vec3<F> multiple_scattering(Vec3<F> f_avg, F e_avg) {
  return f_avg * f_avg * e_avg / (Vec3<F>(1) - f_avg * (1 - e_avg));
}

/// Whether highlights are stretched.
KERNEL bool is_stretched(const Base& b) { return kRich && b.anisotropic.aspect < 1; }
/// Whether some light travels inside the body.
KERNEL bool has_body(const Base& b) { return kRich && b.subsurface_probability > 0; }
KERNEL bool has_film(const ThinFilm& film) { return kRich && film.weight > 0; }

/// w: local
KERNEL Albedo base_albedo(const Base& b, vec3 w) {
  if (b.delta) return {1, schlick_weight(w.z)};
  return is_stretched(b) ? albedo_at(b.anisotropic, w) : albedo_at(b.albedo, w.z);
}

/// Share of light that the coat reflects.
template <class F>
KERNEL F coat_albedo(const OpaqueBase<F>& b, const AlbedoOf<F>& a) {
  return b.coat_f0 * (a.total - a.schlick) + b.coat_f90 * a.schlick +
         b.coat_multiple * (1 - a.total);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
