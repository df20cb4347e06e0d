// How much of which lobe the base of a material has, seen from a direction. Called by bsdf.h.
#pragma once

#include "kernels/bsdf/base_film.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// The hue of a colour at luminance 1; white of black.
KERNEL vec3 tint_of(vec3 color) {
  const float light = luminance(color);
  return light > 0 ? color / light : vec3(1);
}

/// Reflectance of a dielectric in something of index `outside` at normal incidence, coloured, in
/// full.
KERNEL vec3 dielectric_f0(const MaterialValues& m, float outside) {
  vec3 color = m.specular_color * sqr((m.ior - outside) / (m.ior + outside));
  if (m.specular_tint > 0) {
    color *= vec3(1) + (tint_of(m.base_color) - vec3(1)) * m.specular_tint;
  }
  return glm::min(color, vec3(1));
}

KERNEL ThinFilm film_of(const MaterialValues& m, float outside) {
  const float nanometre = 1e-9f;
  return {m.iridescence_thickness > 0 ? m.iridescence : 0, m.iridescence_ior / outside,
          2 * nanometre * m.iridescence_thickness * m.iridescence_ior};
}

/// What lies under the coat: a share of its light travels inside, the rest is Lambert's. Where
/// there is no inside to travel in, all of it is.
struct Body {
  vec3 color;
  float inside;
};
KERNEL Body body_of(const MaterialValues& m, const ShadingPoint& at) {
  if (!kRich || !(m.subsurface > 0)) return {m.base_color, 0};
  const bool has_inside = !at.thin_walled && dot(at.wo, at.ng) >= 0;
  const vec3 color = m.base_color * (1 - m.subsurface);
  if (!has_inside || is_black(m.subsurface_radius)) {
    return {color + m.subsurface_color * m.subsurface, 0};
  }
  return {color, m.subsurface};
}

/// What coat and metal are made of.
template <class F>
struct OpaqueMaterial {
  Vec3<F> base_color;
  Vec3<F> f0;  // of the coat, in full
  F specular, metallic;
  F plastic;  // weight of the coat
};

/// Their Fresnel. Returns its averages by cosine.
template <class F>
KERNEL ReflectancesOf<F> set_fresnel(OpaqueBase<F>& b, const OpaqueMaterial<F>& m) {
  const Vec3<F> coat_f0 = m.f0 * m.specular;
  b.f0 = coat_f0 * m.plastic + m.base_color * m.metallic;
  b.f90 = m.specular * m.plastic + m.metallic;
  b.coat_f0 = max_component(coat_f0);
  b.coat_f90 = m.specular;
  return {coat_f0 + (Vec3<F>(m.specular) - coat_f0) * F(kSchlickMean),
          m.base_color + (Vec3<F>(1) - m.base_color) * F(kSchlickMean)};
}

/// What their microfacets scatter more than once, per unit of light that they lose. Returns that of
/// the coat, in full.
template <class F>
KERNEL Vec3<F> set_multiple(OpaqueBase<F>& b, const OpaqueMaterial<F>& m,
                            const ReflectancesOf<F>& mean, const AlbedoOf<F>& average) {
  const Vec3<F> coat = multiple_scattering(mean.coat, average.total);
  b.coat_multiple = max_component(coat);
  b.multiple = coat * m.plastic;
  if (any(m.metallic > 0)) {
    b.multiple += multiple_scattering(mean.metal, average.total) * m.metallic;
  }
  return coat;
}

/// What microfacets seen from wo reflect at once. out: their albedo there
template <class F>
KERNEL F facets_reflect(const OpaqueBase<F>& b, const AlbedoOf<F>& out) {
  return luminance(b.f0) * (out.total - out.schlick) + b.f90 * out.schlick;
}

/// The lobes sampled by cosine, from what multiple scattering is per unit of lost light. Returns
/// their albedo.
///
/// under      light that leaves the coat's underside towards wo
/// lost       share of light that microfacets lose towards wo
template <class F>
KERNEL F set_diffuse(OpaqueBase<F>& b, Vec3<F> under, F lost, const AlbedoOf<F>& average) {
  b.average_entering = max2(1 - coat_albedo(b, average), F(1e-4f));
  const F share = luminance(under) + luminance(b.multiple) * lost;
  b.diffuse = under * (kInvPi / b.average_entering);
  b.multiple *= kInvPi * lost / max2(1 - average.total, F(1e-4f));
  return share;
}

/// Share of light that rough glass gives up: tables give up to so much too much between their
/// entries, and more where they stand for stretched microfacets, a lobe apart or a film.
inline constexpr float kTableMargin = 1e-3f;
inline constexpr float kWideTableMargin = 4e-3f;

/// The lobes that reflect. Returns the albedo of those sampled by cosine and by microfacets.
KERNEL vec2 set_reflection(Base& b, const MaterialValues& m, const ShadingPoint& at) {
  const Body body = body_of(m, at);
  b.plastic = (1 - m.metallic) * (1 - m.transmission);
  b.metallic = m.metallic;
  const OpaqueMaterial<float> opaque{m.base_color, dielectric_f0(m, at.outside), m.specular,
                                     m.metallic, b.plastic};
  const Albedo average = b.delta           ? Albedo{1, kSchlickMean}
                         : is_stretched(b) ? albedo_average(b.anisotropic)
                                           : albedo_average(b.albedo);
  const Albedo out = base_albedo(b, b.wo);
  Reflectances mean = set_fresnel(b, opaque);
  const bool covered = has_film(b.film) && b.f90 > 0;
  if (covered) {
    b.film_coat = amplitude_below(b.film, opaque.f0);
    b.film_metal = amplitude_below(b.film, m.base_color);
    cover(mean, b, average_film(b));
  }
  float lost = 0;
  vec3 multiple(0);  // of the coat
  b.multiple = vec3(0);
  b.coat_multiple = 0;
  if (!b.delta) {
    multiple = set_multiple(b, opaque, mean, average);
    lost = max2(1 - out.total, 0.0f);
    if (is_stretched(b)) lost *= 1 - kWideTableMargin;
  }
  vec3 coat(coat_albedo(b, out));
  float facets = facets_reflect(b, out);
  if (covered) {
    const Reflectances film = seen_film(b);
    const vec3 once = coat - vec3(b.coat_multiple * lost);
    coat = once + (film.coat * out.total - once) * b.film.weight + multiple * lost;
    facets +=
        (max_component(film.coat * b.plastic + film.metal * m.metallic) * out.total - facets) *
        b.film.weight;
    // Towards wi, the coat of Schlick's that reflects as much on average.
    b.coat_f0 =
        max2(max_component(mean.coat) - m.specular * kSchlickMean, 0.0f) / (1 - kSchlickMean);
  }
  const vec3 entering = vec3(1) - coat;
  b.subsurface = body.inside * b.plastic * min_component(entering);
  return vec2(set_diffuse(b, body.color * (entering * b.plastic), lost, average), facets);
}

/// Share of light that a face of glass without a film reflects, of all that it gives off.
KERNEL float face_reflectance(const Base& b, float roughness) {
  if (sqr(roughness) < kDeltaAlpha) return fresnel_dielectric(b.wo.z, b.eta).reflectance;
  const GlassAlbedo share = glass_albedo(b.wo.z, roughness, b.eta);
  const float reflected = share.reflected + share.totally;
  return reflected / (reflected + share.refracted);
}

/// Bounds the weight of light that refracts by itself.
inline constexpr float kMostThrough = 2;

/// Reflection and what passes as lobes of their own: each is scaled to give off its share whatever
/// its roughness. Returns as set_interface().
HELIO_GPU_NOINLINE KERNEL vec2 set_apart(Base& b, const MaterialValues& m, float through) {
  // From inside what refracts roughly would be caught by a polished face: light that came in at an
  // angle must get out at it.
  const bool leaves = b.interface == Interface::kSplit && b.eta < 1;
  vec3 reflected(face_reflectance(b, leaves ? through : m.roughness));
  if (has_film(b.glass_film))
    reflected = glm::clamp(reflected + film_on_face(b).whole, vec3(0), vec3(1));
  float smallest = 0;
  b.through_scale = 1;
  if (b.interface == Interface::kSheet) {
    // Both faces, and the bounces between them.
    reflected = 2.0f * reflected / (vec3(1) + reflected);
    const float aspect = b.anisotropic.aspect;
    b.through = {sqr(through) / aspect, sqr(through) * aspect};
    const AlbedoRow round = albedo_row(through);
    if (!b.through_delta) {
      b.through_scale =
          1 / (aspect < 1 ? albedo_at({through, aspect}, b.wo) : albedo_at(round, b.wo.z)).total;
    }
  } else {
    b.through = {sqr(through), sqr(through)};
    const GlassAlbedo share = glass_albedo(b.wo.z, through, b.eta);
    const float passes = max2(share.refracted + share.kept, 1e-6f);
    b.through_scale = 1 / passes;
    // Near total reflection few facets refract: they need not carry more than this.
    smallest = 1 - kMostThrough * passes;
  }
  b.glass_reflectance = glm::max(b.glass_specular * reflected, vec3(smallest));
  b.glass_scale = vec3(1 / base_albedo(b, b.wo).total);
  const vec3 passing = b.glass_tint * (vec3(1) - b.glass_reflectance);
  // Each is chosen by the root of its second moment: few samples of refraction may succeed.
  return vec2(luminance(b.glass_reflectance), luminance(passing) * std::sqrt(b.through_scale)) *
         b.glass;
}

/// The interface of glass. Returns shares of sampling for its microfacets and for what passes
/// apart.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL vec2 set_interface(Base& b, const MaterialValues& m,
                                                          const ShadingPoint& at) {
  const bool enters = at.thin_walled || dot(at.wo, at.ng) >= 0;
  const float through = 1 - (1 - m.roughness) * (1 - m.transmission_roughness);
  b.through_delta = sqr(through) < kDeltaAlpha;
  const bool apart = kRich && (m.transmission_roughness > 0 || is_stretched(b));
  b.interface = kRich && at.thin_walled     ? Interface::kSheet
                : apart && !b.through_delta ? Interface::kSplit
                                            : Interface::kJoint;
  if (!b.through_delta) {
    const bool wide = b.interface != Interface::kJoint || has_film(b.film);
    b.glass *= 1 - (wide ? kWideTableMargin : kTableMargin);
  }
  float ior = m.ior / at.outside;
  // A rough interface of index 1 has no half vector: the smallest step that still has one.
  if (!b.through_delta) ior = ior < 1 ? min2(ior, 1 / 1.01f) : max2(ior, 1.01f);
  b.eta = enters ? ior : 1 / ior;
  b.glass_film = {b.film.weight, b.film.ior / (enters ? 1 : ior), b.film.way};
  const vec3 color = m.base_color;
  b.glass_tint =
      at.thin_walled ? color : vec3(std::sqrt(color.x), std::sqrt(color.y), std::sqrt(color.z));
  b.glass_specular = glm::min(m.specular_color * m.specular, vec3(1));
  if (b.interface != Interface::kJoint) return set_apart(b, m, through);
  b.through = b.facets;
  b.glass_scale = vec3(1);
  if (!b.delta) {
    const GlassAlbedo share = glass_albedo(b.wo.z, m.roughness, b.eta);
    // What a low `specular` takes from the reflection refracts, and the film's share reflects.
    vec3 reflected = b.glass_specular * share.reflected;
    vec3 kept = (vec3(1) - b.glass_specular) * share.kept;
    if (has_film(b.glass_film)) {
      const FilmOnFace film = film_on_face(b);
      reflected += b.glass_specular * film.reflected;
      kept -= b.glass_specular * film.refracted;
    }
    b.glass_scale = 1.0f / (vec3(share.totally + share.refracted) + reflected + kept);
  }
  return vec2(b.glass, 0);
}

/// A material at a point, seen from wo (world). n, ng: on wo's side. facets: not only Lambert.
KERNEL void set_base(Base& b, const MaterialValues& m, const ShadingPoint& at, vec3 n) {
  const bool facets = m.specular > 0 || m.metallic > 0 || m.transmission > 0;
  if (facets) n = bend_normal(b.ng, at.wo, n);
  const bool stretched = kRich && m.anisotropic > 0;
  b.frame = stretched ? make_frame(n, at.tangent) : make_frame(n);
  b.wo = to_local(b.frame, at.wo);
  b.wo.z = max2(b.wo.z, 1e-4f);
  const float alpha = sqr(m.roughness);
  const float aspect = stretched ? std::sqrt(1 - 0.9f * m.anisotropic) : 1;
  b.facets = {alpha / aspect, alpha * aspect};
  b.anisotropic = {m.roughness, aspect};
  b.delta = alpha < kDeltaAlpha;
  b.glass = (1 - m.metallic) * m.transmission;
  b.film = film_of(m, at.outside);
  b.interface = Interface::kNone;
  b.facet_probability = 0;
  if (!facets) {
    const Body body = body_of(m, at);
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
  if (!b.delta) b.albedo = albedo_row(m.roughness);
  vec2 share = set_reflection(b, m, at);
  float through = 0;
  if (b.glass > 0) {
    const vec2 passing = set_interface(b, m, at);
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
