// The lobes of the base: values, densities and sampling. Called by bsdf.h.
#pragma once

#include "kernels/bsdf/base_weights.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// f(wo, wi) |cos|, split by lobe, and the density [1/sr] with which sampling takes wi. Delta lobes
/// are left out.
template <class F>
struct BsdfValueOf {
  Vec3<F> diffuse{0};
  Vec3<F> glossy{0};  // or transmission, for wi below the surface
  F pdf = 0;
};
using BsdfValue = BsdfValueOf<float>;

enum class Lobe : u8 { kDiffuse, kGlossy, kTransmission, kSubsurface };

struct BsdfSample {
  vec3 wi;          // unit, world; unset for kSubsurface
  vec3 weight{0};   // f |cos| / pdf; for kSubsurface that of light that enters
  vec3 diffuse{0};  // what of the weight is diffuse
  float pdf;        // 1/sr; 0: a delta lobe, or light that travels inside
  float eta;        // index of the far side over the near side when refracted, else 1
  Lobe lobe;
};

/// Whether what passes is a lobe of its own, and the probability of choosing it.
KERNEL bool passes_apart(const Base& b) { return kRich && b.interface > Interface::kJoint; }
KERNEL float through_probability(const Base& b) {
  return max2(1 - b.diffuse_probability - b.facet_probability - b.subsurface_probability, 0.0f);
}

/// Its colour.
KERNEL vec3 through_color(const Base& b) {
  return b.glass_tint * (vec3(1) - b.glass_reflectance) * (b.glass * b.through_scale);
}

/// What a microfacet of coat and metal reflects at cosine c = wo.h.
template <class F>
KERNEL Vec3<F> opaque_facet(const OpaqueBase<F>& b, F c) {
  return b.f0 + (Vec3<F>(b.f90) - b.f0) * schlick_weight(c);
}

/// What a microfacet does with light at cosine c = wo.h.
struct Facet {
  vec3 reflected;
  vec3 transmitted;
  float cos_t;  // of the refracted direction
  float reflect_probability;
};
KERNEL Facet facet_of(const Base& b, float c) {
  Facet f{opaque_facet(b, c), vec3(0), 0, 1};
  if (has_film(b.film) && b.f90 > 0) {
    const Reflectances film = film_at(b, c);
    const vec3 covered = film.coat * b.plastic + film.metal * b.metallic;
    f.reflected += (covered - f.reflected) * b.film.weight;
  }
  if (b.glass <= 0) return f;
  const vec3 glass = b.glass_scale * b.glass;
  if (passes_apart(b)) {
    f.reflected += b.glass_reflectance * glass;
    return f;
  }
  const Fresnel exact = fresnel_dielectric(c, b.eta);
  const vec3 r = b.glass_specular * glass_at(b, c, exact.reflectance);
  f.cos_t = exact.cos_t;
  if (exact.cos_t > 0) {
    f.reflected += r * glass;
    f.transmitted = b.glass_tint * (vec3(1) - r) * glass;
  } else {
    f.reflected += glass;
  }
  const float up = luminance(f.reflected);
  const float down = luminance(f.transmitted);
  f.reflect_probability = up + down > 0 ? up / (up + down) : 1;
  return f;
}

HELIO_GPU_NOINLINE KERNEL void add_sheet(const Base& b, vec3 wi, BsdfValue& out) {
  const vec3 mirrored(wi.x, wi.y, -wi.z);
  const float density = ggx_density(normalize(b.wo + mirrored), b.through);
  out.glossy = through_color(b) * (ggx_reflection(b.wo, mirrored, density, b.through) * mirrored.z);
  out.pdf = through_probability(b) * 0.25f * ggx_visible_density(b.wo, density, b.through);
}

HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL void add_refraction(const Base& b, vec3 wi, BsdfValue& out) {
  vec3 h = b.wo + wi * b.eta;
  h = normalize(h.z < 0 ? -h : h);
  const float wo_h = dot(b.wo, h);
  const float wi_h = dot(wi, h);
  if (wo_h <= 0 || wi_h >= 0) return;
  vec3 color;
  float probability;
  if (passes_apart(b)) {
    color = through_color(b);
    probability = through_probability(b);
  } else {
    const Facet f = facet_of(b, wo_h);
    color = f.transmitted;
    probability = b.facet_probability * (1 - f.reflect_probability);
  }
  const float density = ggx_density(h, b.through);
  const float jacobian = -wi_h / sqr(wi_h + wo_h / b.eta);
  const float lambdas = ggx_lambda(b.wo, b.through) + ggx_lambda(wi, b.through);
  // Walter et al. 2007, equation 21, over eta^2: radiance spreads or gathers as it refracts.
  out.glossy = color * (density * wo_h * jacobian / (b.wo.z * (1 + lambdas) * sqr(b.eta)));
  out.pdf = probability * jacobian * wo_h * ggx_visible_density(b.wo, density, b.through);
}

/// Adds what microfacets with normal h reflect. probability: of sampling them by reflection
template <class F>
KERNEL void add_facets(const OpaqueBase<F>& b, Vec3<F> wi, Vec3<F> h, Vec3<F> reflected,
                       F probability, BsdfValueOf<F>& out) {
  const F density = ggx_density(h, b.facets);
  out.glossy += reflected * (ggx_reflection(b.wo, wi, density, b.facets) * wi.z);
  out.pdf += probability * 0.25f * ggx_visible_density(b.wo, density, b.facets);
}

KERNEL void add_reflection(const Base& b, vec3 wi, BsdfValue& out) {
  const vec3 h = normalize(b.wo + wi);
  const Facet f = facet_of(b, dot(b.wo, h));
  add_facets(b, wi, h, f.reflected, b.facet_probability * f.reflect_probability, out);
}

/// Adds the lobes sampled by cosine, under a coat. in: albedo of the microfacets at wi
template <class F>
KERNEL void add_coated(const OpaqueBase<F>& b, Vec3<F> wi, const AlbedoOf<F>& in,
                       BsdfValueOf<F>& out) {
  out.diffuse = b.diffuse * wi.z * (1 - coat_albedo(b, in));
  out.glossy = b.multiple * (wi.z * max2(1 - in.total, F(0)));
}

/// Light that passes the surface to wi, below it (local).
KERNEL void add_through(const Base& b, vec3 wi, BsdfValue& out) {
  if (b.interface == Interface::kNone) return;
  const bool apart = passes_apart(b);
  if (apart ? b.through_delta : b.delta) return;
  if (apart && b.interface == Interface::kSheet)
    add_sheet(b, wi, out);
  else
    add_refraction(b, wi, out);
}

/// wi     local
/// side   cosine of wi to the geometric normal
KERNEL BsdfValue evaluate_base(const Base& b, vec3 wi, float side) {
  BsdfValue out;
  if (wi.z <= 0) {
    if (wi.z < 0 && side < 0) add_through(b, wi, out);
    return out;
  }
  if (side <= 0) return out;
  if (b.diffuse_probability > 0) {
    out.pdf = b.diffuse_probability * wi.z * kInvPi;
    if (b.coated)
      add_coated(b, wi, base_albedo(b, wi), out);
    else
      out.diffuse = b.diffuse * wi.z;
  }
  if (b.facet_probability > 0 && !b.delta) add_reflection(b, wi, out);
  return out;
}

/// A direction that has been chosen, before its weight is known unless it is that of a mirror or
/// of light that travels inside.
struct Chosen {
  bool valid;
  bool delta;
};

/// Passes on light to the other side by a lobe of its own.
HELIO_GPU_NOINLINE KERNEL Chosen choose_through(const Base& b, vec2 u, BsdfSample& s) {
  const vec3 h = b.through_delta ? vec3(0, 0, 1) : sample_ggx(b.wo, b.through, u);
  const float wo_h = dot(b.wo, h);
  s.lobe = Lobe::kTransmission;
  s.eta = 1;
  vec3 wi;
  if (b.interface == Interface::kSheet) {
    wi = h * (2 * wo_h) - b.wo;
    wi.z = -wi.z;
    s.weight = through_color(b) / through_probability(b);
  } else {
    const Fresnel exact = fresnel_dielectric(wo_h, b.eta);
    if (!(exact.cos_t > 0)) return {false, false};
    wi = h * (wo_h / b.eta - exact.cos_t) - b.wo * (1 / b.eta);
    s.eta = b.eta;
  }
  s.wi = to_world(b.frame, wi);
  return {wo_h > 0 && wi.z < 0 && dot(s.wi, b.ng) < 0, b.through_delta};
}

/// Reflects from or refracts through a microfacet. u: for the choice between the two.
KERNEL Chosen choose_facet(const Base& b, float u, vec3 h, BsdfSample& s) {
  const float wo_h = dot(b.wo, h);
  if (wo_h <= 0) return {false, false};
  const Facet f = facet_of(b, wo_h);
  const bool reflect = u < f.reflect_probability;
  const vec3 wi =
      reflect ? h * (2 * wo_h) - b.wo : h * (wo_h / b.eta - f.cos_t) - b.wo * (1 / b.eta);
  if (reflect != (wi.z > 0)) return {false, false};
  s.wi = to_world(b.frame, wi);
  s.lobe = reflect ? Lobe::kGlossy : Lobe::kTransmission;
  s.eta = reflect ? 1 : b.eta;
  if (!b.delta) return {true, false};
  s.weight = reflect
                 ? f.reflected / (f.reflect_probability * b.facet_probability)
                 : f.transmitted / ((1 - f.reflect_probability) * b.facet_probability * sqr(b.eta));
  return {dot(s.wi, b.ng) * (reflect ? 1.0f : -1.0f) > 0, true};
}

/// u_lobe, u   uniform in [0, 1)
KERNEL Chosen choose_base(const Base& b, float u_lobe, vec2 u, BsdfSample& s) {
  if (u_lobe < b.diffuse_probability) {
    s.wi = to_world(b.frame, sample_cosine(u));
    s.lobe = Lobe::kDiffuse;
    s.eta = 1;
    return {true, false};
  }
  float rest = u_lobe - b.diffuse_probability;
  // Where there are no facets, rounding must not choose them.
  const bool last = b.facet_probability <= 0 && !passes_apart(b);
  if (has_body(b) && (rest < b.subsurface_probability || last)) {
    s.weight = vec3(b.subsurface / b.subsurface_probability);
    s.lobe = Lobe::kSubsurface;
    s.eta = 1;
    return {true, true};
  }
  rest -= b.subsurface_probability;
  if (passes_apart(b) && rest >= b.facet_probability) return choose_through(b, u, s);
  return choose_facet(b, rest / b.facet_probability,
                      b.delta ? vec3(0, 0, 1) : sample_ggx(b.wo, b.facets, u), s);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
