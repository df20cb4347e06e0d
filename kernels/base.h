// The base of the material: its lobes and their weights. Local frames: z is the shading normal and
// wo.z > 0. Called by base_lobes.h and bsdf.h.
#pragma once

#include "kernels/ggx.h"
#include "kernels/surface.h"

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

/// A sum of
///   diffuse   Lambert under the coat, scaled by what the coat lets in and out
///   inside    what enters the coat, travels inside the body and leaves elsewhere (subsurface.h)
///   facets    GGX reflection of coat, metal and glass, Fresnel after Schlick or exact, and the
///             light that microfacets scatter more than once
///   through   what passes to the other side
/// The opaque lobes show on both sides of the surface.
struct Base {
  Frame frame;    // z: shading normal on wo's side
  vec3 ng;        // geometric normal on wo's side
  vec3 wo;        // local
  vec3 diffuse;   // 1/sr, but for the factor 1 - coat albedo of wi
  vec3 multiple;  // 1/sr, but for the factor 1 - albedo of wi
  vec3 f0;        // Schlick's Fresnel of coat and metal together
  float f90;
  float coat_f0, coat_f90, coat_multiple;  // of the coat alone, in full
  float average_entering;                  // average over wi of 1 - coat albedo, layers included
  AlbedoRow albedo;
  AnisotropicRow anisotropic;  // instead, where the aspect is not 1
  vec3 glass_tint;             // of light that passes
  vec3 glass_specular;         // scales the exact Fresnel reflectance
  vec3 glass_reflectance;      // where what passes is a lobe of its own: constant over microfacets
  float glass;                 // weight of the interface; 0: none
  float glass_scale;           // makes up for light that a rough interface scatters more than once
  float through_scale;         // the same of what passes by itself
  float eta;                   // index of the far side over that of wo's side
  Ggx facets, through;
  float diffuse_probability;     // of sampling by cosine
  float facet_probability;       // of sampling a microfacet; what is left: `through` on its own
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
KERNEL vec3 multiple_scattering(vec3 f_avg, float e_avg) {
  return f_avg * f_avg * e_avg / (vec3(1) - f_avg * (1 - e_avg));
}

/// w: local
KERNEL Albedo base_albedo(const Base& b, vec3 w) {
  if (b.delta) return {1, schlick_weight(w.z)};
  return b.anisotropic.aspect < 1 ? albedo_at(b.anisotropic, w) : albedo_at(b.albedo, w.z);
}

/// Share of light that the coat reflects.
KERNEL float coat_albedo(const Base& b, Albedo a) {
  return b.coat_f0 * (a.total - a.schlick) + b.coat_f90 * a.schlick +
         b.coat_multiple * (1 - a.total);
}

/// The hue of a colour at luminance 1; white of black.
KERNEL vec3 tint_of(vec3 color) {
  const float light = luminance(color);
  return light > 0 ? color / light : vec3(1);
}

/// Reflectance of a dielectric at normal incidence, coloured.
KERNEL vec3 dielectric_f0(const MaterialValues& m) {
  vec3 color = m.specular_color * sqr((m.ior - 1) / (m.ior + 1));
  if (m.specular_tint > 0) {
    color *= vec3(1) + (tint_of(m.base_color) - vec3(1)) * m.specular_tint;
  }
  return glm::min(color, vec3(1)) * m.specular;
}

/// What lies under the coat: a share of its light travels inside, the rest is Lambert's. Where
/// there is no inside to travel in, all of it is.
struct Body {
  vec3 color;
  float inside;
};
KERNEL Body body_of(const MaterialValues& m, bool has_inside) {
  if (!(m.subsurface > 0)) return {m.base_color, 0};
  const vec3 color = m.base_color * (1 - m.subsurface);
  if (!has_inside || is_black(m.subsurface_radius)) {
    return {color + m.subsurface_color * m.subsurface, 0};
  }
  return {color, m.subsurface};
}

/// The lobes that reflect. Returns the albedo of those sampled by cosine and by microfacets.
KERNEL vec2 set_reflection(Base& b, const MaterialValues& m, const Body& body) {
  const float plastic = (1 - m.metallic) * (1 - m.transmission);
  const vec3 coat_f0 = dielectric_f0(m);
  const float f_steps = 1 / 21.0f;  // the average of Schlick's weight
  const Albedo average = b.delta                    ? Albedo{1, f_steps}
                         : b.anisotropic.aspect < 1 ? albedo_average(b.anisotropic)
                                                    : albedo_average(m.roughness);
  const Albedo out = base_albedo(b, b.wo);

  b.f0 = coat_f0 * plastic + m.base_color * m.metallic;
  b.f90 = m.specular * plastic + m.metallic;
  b.coat_f0 = max_component(coat_f0);
  b.coat_f90 = m.specular;
  b.multiple = vec3(0);
  b.coat_multiple = 0;
  float lost = 0;
  if (!b.delta) {
    const vec3 metal_avg = m.base_color + (vec3(1) - m.base_color) * f_steps;
    const vec3 coat_avg = coat_f0 + (vec3(m.specular) - coat_f0) * f_steps;
    const vec3 coat = multiple_scattering(coat_avg, average.total);
    b.coat_multiple = max_component(coat);
    lost = max2(1 - out.total, 0.0f);
    b.multiple = multiple_scattering(metal_avg, average.total) * m.metallic + coat * plastic;
  }
  const float entering = 1 - coat_albedo(b, out);
  b.average_entering = max2(1 - coat_albedo(b, average), 1e-4f);
  const vec3 diffuse = body.color * (plastic * entering);
  b.subsurface = body.inside * plastic * entering;

  const vec2 share(luminance(diffuse) + luminance(b.multiple) * lost,
                   luminance(b.f0) * (out.total - out.schlick) + b.f90 * out.schlick);
  b.diffuse = diffuse * (kInvPi / b.average_entering);
  b.multiple *= kInvPi * lost / max2(1 - average.total, 1e-4f);
  return share;
}

/// Share of light that a face of glass reflects, of all that it gives off.
KERNEL float face_reflectance(const Base& b, float roughness) {
  if (b.delta) return fresnel_dielectric(b.wo.z, b.eta).reflectance;
  const GlassAlbedo share = glass_albedo(b.wo.z, roughness, b.eta);
  return share.reflected / (share.reflected + share.refracted);
}

/// Bounds the weight of light that refracts by itself.
inline constexpr float kMostThrough = 1.25f;

/// Reflection and what passes as lobes of their own: each is scaled to give off its share whatever
/// its roughness. Returns as set_interface().
KERNEL vec2 set_apart(Base& b, const MaterialValues& m, float through) {
  float reflected = face_reflectance(b, m.roughness);
  float smallest = 0;
  b.through_scale = 1;
  if (b.interface == Interface::kSheet) {
    reflected = 2 * reflected / (1 + reflected);  // both faces, and the bounces between them
    const float aspect = b.anisotropic.aspect;
    b.through = {sqr(through) / aspect, sqr(through) * aspect};
    const AlbedoRow round = albedo_row(kReflectionAlbedo, 2 * kAlbedoCosines, through);
    if (!b.through_delta) {
      b.through_scale =
          1 / (aspect < 1 ? albedo_at({through, aspect}, b.wo) : albedo_at(round, b.wo.z)).total;
    }
  } else {
    b.through = {sqr(through), sqr(through)};
    const float refracted = max2(glass_albedo(b.wo.z, through, b.eta).refracted, 1e-6f);
    b.through_scale = 1 / refracted;
    // Near total reflection few facets refract: they need not carry more than this.
    smallest = 1 - kMostThrough * refracted;
  }
  b.glass_reflectance = glm::max(b.glass_specular * reflected, vec3(smallest));
  b.glass_scale = 1 / base_albedo(b, b.wo).total;
  const vec3 passing = b.glass_tint * (vec3(1) - b.glass_reflectance);
  // Refraction is chosen by its largest weight, not its albedo: few of its samples may succeed.
  return vec2(luminance(b.glass_reflectance), luminance(passing) * b.through_scale) * b.glass;
}

/// The interface of glass. Returns shares of sampling for its microfacets and for what passes
/// apart.
KERNEL vec2 set_interface(Base& b, const MaterialValues& m, bool front, bool thin_walled) {
  const float through = 1 - (1 - m.roughness) * (1 - m.transmission_roughness);
  b.through_delta = sqr(through) < kDeltaAlpha;
  const bool apart = m.transmission_roughness > 0 || b.anisotropic.aspect < 1;
  b.interface = thin_walled                 ? Interface::kSheet
                : apart && !b.through_delta ? Interface::kSplit
                                            : Interface::kJoint;
  // A rough interface of index 1 has no half vector: the smallest step that still has one.
  const float ior = b.through_delta ? m.ior : max2(m.ior, 1.01f);
  b.eta = front || thin_walled ? ior : 1 / ior;
  const vec3 color = m.base_color;
  b.glass_tint =
      thin_walled ? color : vec3(std::sqrt(color.x), std::sqrt(color.y), std::sqrt(color.z));
  b.glass_specular = glm::min(m.specular_color * m.specular, vec3(1));
  if (b.interface != Interface::kJoint) return set_apart(b, m, through);
  b.through = b.facets;
  b.glass_scale = 1;
  if (!b.delta) {
    const GlassAlbedo share = glass_albedo(b.wo.z, m.roughness, b.eta);
    b.glass_scale = 1 / (share.reflected + share.refracted);
  }
  return vec2(b.glass, 0);
}

/// A material at a point, seen from wo (world). n, ng: on wo's side. facets: not only Lambert.
KERNEL void set_base(Base& b, const MaterialValues& m, const ShadingPoint& at, vec3 n) {
  const bool facets = m.specular > 0 || m.metallic > 0 || m.transmission > 0;
  if (facets) n = bend_normal(b.ng, at.wo, n);
  b.frame = m.anisotropic > 0 ? make_frame(n, at.tangent) : make_frame(n);
  b.wo = to_local(b.frame, at.wo);
  b.wo.z = max2(b.wo.z, 1e-4f);
  const float alpha = sqr(m.roughness);
  const float aspect = m.anisotropic > 0 ? std::sqrt(1 - 0.9f * m.anisotropic) : 1;
  b.facets = {alpha / aspect, alpha * aspect};
  b.anisotropic = {m.roughness, aspect};
  b.delta = alpha < kDeltaAlpha;
  b.glass = (1 - m.metallic) * m.transmission;
  b.interface = Interface::kNone;
  b.facet_probability = 0;
  const Body body = body_of(m, !at.thin_walled && dot(at.wo, at.ng) >= 0);
  if (!facets) {
    b.diffuse = body.color * kInvPi;
    b.multiple = b.f0 = vec3(0);
    b.f90 = 0;
    b.coated = false;
    b.average_entering = 1;
    b.subsurface = body.inside;
    const float inside = body.inside * luminance(m.subsurface_color);
    b.reflectance = luminance(body.color) + inside;
    b.subsurface_probability = inside > 0 ? inside / b.reflectance : 0;
    b.diffuse_probability = 1 - b.subsurface_probability;
    return;
  }
  b.coated = true;
  if (!b.delta) b.albedo = albedo_row(kReflectionAlbedo, 2 * kAlbedoCosines, m.roughness);
  vec2 share = set_reflection(b, m, body);
  float through = 0;
  if (b.glass > 0) {
    const vec2 passing = set_interface(b, m, dot(at.wo, at.ng) >= 0, at.thin_walled);
    share.y += passing.x;
    through = passing.y;
  }
  const float inside = b.subsurface * luminance(m.subsurface_color);
  b.reflectance = share.x + share.y + through + inside;
  b.diffuse_probability = share.x > 0 ? share.x / b.reflectance : 0;
  b.subsurface_probability = inside > 0 ? inside / b.reflectance : 0;
  b.facet_probability = 1 - b.diffuse_probability - b.subsurface_probability;
  if (through > 0) b.facet_probability *= share.y / (share.y + through);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
