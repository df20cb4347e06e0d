// The base of the material: its lobes. Local frames: z is the shading normal and wo.z > 0. Set by
// base_weights.h, evaluated by base_lobes.h.
#pragma once

#include "kernels/bsdf/iridescence.h"
#include "kernels/geometry/surface.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Ways in which light passes the interface of a transmitting material.
enum class Interface : u8 {
  kNone,
  kJoint,  // each microfacet reflects or refracts
  kSplit,  // refraction has a roughness of its own, or the reflection is stretched
  kSheet,  // thin-walled: straight on, through both faces
};

/// Features that this program renders; code for the others is left out.
inline constexpr Features kFeatures = kRich ? Features::kAll : Features::kGlass;

/// Where a condition holds, of surfaces that have everything or, for glassy(), glass.
template <Features S, class Bool>
KERNEL Bool rich(Bool condition) {
  return S == Features::kAll ? condition : Bool(false);
}
template <Features S, class Bool>
KERNEL Bool glassy(Bool condition) {
  return S != Features::kOpaque ? condition : Bool(false);
}

/// A sum of
///   diffuse   Lambert under the coat, scaled by what the coat lets in and out; some of it leaves
///             on the far side, as from a leaf
///   inside    what enters the coat, travels inside the body and leaves elsewhere (subsurface.h)
///   facets    GGX reflection of coat, metal and glass, Fresnel after Schlick or exact, and the
///             light that microfacets scatter more than once
///   through   what passes to the other side; its probability is what the others leave
template <class F, Features S>
struct BaseOf {
  FrameOf<F> frame;  // z: shading normal on wo's side
  Vec3<F> ng;        // geometric normal on wo's side
  Vec3<F> wo;        // local
  Vec3<F> diffuse;   // 1/sr, but for the factor 1 - coat albedo of wi
  Vec3<F> multiple;  // 1/sr, but for the factor 1 - albedo of wi
  Vec3<F> f0;        // Schlick's Fresnel of coat and metal together
  F f90;
  F coat_f0, coat_f90, coat_multiple;  // of the coat alone, in full
  F average_entering;                  // average over wi of 1 - coat albedo, layers included
  Vec3<F> diffuse_through;             // as `diffuse`, of light that leaves on the far side
  F diffuse_through_share;             // of what is sampled by cosine
  AlbedoRowOf<F> albedo;
  GgxOf<F> facets;
  F diffuse_probability;            // of sampling by cosine
  F facet_probability;              // of sampling a microfacet
  F plastic, metallic;              // weights of coat and metal
  ThinFilmOf<F> film;               // on both
  Vec3<F> film_coat, film_metal;    // amplitude_below() it; set where there is one
  AnisotropicRowOf<F> anisotropic;  // in place of `albedo`, where the aspect is not 1
  Vec3<F> glass_tint;               // of light that passes
  Vec3<F> glass_specular;           // scales the exact Fresnel reflectance
  Vec3<F> glass_reflectance;  // where what passes is a lobe of its own: constant over microfacets
  F glass;                    // weight of the interface; 0: none
  Vec3<F> glass_scale;        // makes up for light that a rough interface scatters more than once
  F through_scale;            // the same of what passes by itself
  ThinFilmOf<F> glass_film;   // on the interface
  F eta;                      // index of the far side over that of wo's side
  GgxOf<F> through;
  F subsurface_probability;  // of light that travels inside the body
  F subsurface;              // share of light that does
  F reflectance;             // about the share of light that all of it gives off
  EnumOf<F, Interface> interface;
  BoolOf<F> coated;         // what is sampled by cosine depends on the albedo of wi
  BoolOf<F> delta;          // the microfacets are perfect mirrors
  BoolOf<F> through_delta;  // and so is what passes, where it has a roughness of its own
};

/// The normal turned towards ng just as far as a mirror direction needs to leave the surface.
///
/// Source: Cycles 4, ensure_valid_specular_reflection(), which solves dot(reflected, ng) =
/// threshold. ng, ns, wo are unit; wo lies in the hemisphere of ng.
template <class F>
KERNEL Vec3<F> bend_normal(Vec3<F> ng, Vec3<F> wo, Vec3<F> ns) {
  const F cos_ng = dot(wo, ng);
  const F threshold = min2(0.9f * cos_ng, F(0.01f));
  const F cos_ns = dot(ns, wo);
  const BoolOf<F> leaves = (2 * cos_ns * dot(ns, ng) - cos_ng >= threshold) & (cos_ns > 0);
  if (all(leaves)) return ns;
  const Vec3<F> x = normalize_or(ns - ng * dot(ns, ng), make_frame(ng).s);
  const F wx = dot(wo, x);
  const F a = max2(wx * wx + cos_ng * cos_ng, F(1e-12f));
  const F b = 2 * (a + cos_ng * threshold);
  const F c = sqr(threshold + cos_ng);
  const F root = safe_sqrt(b * b - 4 * a * c);
  const F nz2 = clamp01(0.25f * select(wx < 0, b + root, b - root) / a);
  return select(leaves, ns, normalize(x * safe_sqrt(1 - nz2) + ng * sqrt(nz2)));
}

/// A frame about n whose s lies along t as far as it can; t zero: anywhere.
template <class F>
KERNEL FrameOf<F> make_frame(Vec3<F> n, Vec3<F> t) {
  const Vec3<F> s = t - n * dot(n, t);
  const F length2 = dot(s, s);
  return either(
      length2 > 1e-12f,
      [&] {
        const Vec3<F> unit = s * (1 / sqrt(length2));
        return FrameOf<F>{unit, cross(n, unit), n};
      },
      [&] { return make_frame(n); });
}

/// Colour of light that leaves rough microfacets after more than one scattering, per unit of energy
/// that single scattering loses; f_avg is the Fresnel reflectance averaged by cosine.
///
/// Source: Kulla and Conty 2017, "Revisiting Physically Based Shading at Imageworks".
template <class F>
KERNEL Vec3<F> multiple_scattering(Vec3<F> f_avg, F e_avg) {
  return f_avg * f_avg * e_avg / (Vec3<F>(1) - f_avg * (1 - e_avg));
}

/// True if highlights are stretched.
template <class F, Features S>
KERNEL BoolOf<F> is_stretched(const BaseOf<F, S>& b) {
  return rich<S>(b.anisotropic.aspect < 1);
}
/// True if some light travels inside the body.
template <class F, Features S>
KERNEL BoolOf<F> has_body(const BaseOf<F, S>& b) {
  return rich<S>(b.subsurface_probability > 0);
}
template <Features S, class F>
KERNEL BoolOf<F> has_film(const ThinFilmOf<F>& film) {
  return rich<S>(film.weight > 0);
}
/// True where microfacets are perfect mirrors.
template <class F, Features S>
KERNEL BoolOf<F> is_mirror(const BaseOf<F, S>& b) {
  return glassy<S>(b.delta);
}
/// True where light can pass the interface.
template <class F, Features S>
KERNEL BoolOf<F> is_glass(const BaseOf<F, S>& b) {
  return glassy<S>(b.glass > 0);
}

/// w: local
template <class F, Features S>
HELIO_ALWAYS_INLINE KERNEL AlbedoOf<F> base_albedo(const BaseOf<F, S>& b, Vec3<F> w) {
  return either(
      is_mirror(b), [&] { return AlbedoOf<F>{F(1), schlick_weight(w.z)}; },
      [&] {
        return either(
            is_stretched(b), [&] { return albedo_at(b.anisotropic, w); },
            [&] { return albedo_at(b.albedo, w.z); });
      });
}

/// Share of light that the coat reflects.
template <class F, Features S>
KERNEL F coat_albedo(const BaseOf<F, S>& b, const AlbedoOf<F>& a) {
  return b.coat_f0 * (a.total - a.schlick) + b.coat_f90 * a.schlick +
         b.coat_multiple * (1 - a.total);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
