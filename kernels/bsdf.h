// How a surface scatters light: the metallic-roughness material of glTF 2.0 with specular, ior and
// transmission. Called by path.h.
#pragma once

#include "kernels/ggx.h"
#include "kernels/surface.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Microfacets with less than this alpha are a perfect mirror.
inline constexpr float kDeltaAlpha = 1e-3f;

/// A material at a point, seen from direction wo: a sum of
///   diffuse   Lambert under the coat, scaled by what the coat lets in and out
///   glossy    GGX reflection of coat, metal and glass, Fresnel after Schlick or exact, and the
///             light that microfacets scatter more than once
///   transmission   GGX refraction
/// The opaque lobes show on both sides of the surface.
struct Bsdf {
  Frame frame;    // z: shading normal on wo's side
  vec3 ng;        // geometric normal on wo's side
  vec3 wo;        // local
  vec3 diffuse;   // 1/sr, but for the factor 1 - coat albedo of wi
  vec3 multiple;  // 1/sr, but for the factor 1 - albedo of wi
  vec3 f0;        // Schlick's Fresnel of coat and metal together
  float f90;
  float coat_f0, coat_f90, coat_multiple;  // of the coat alone, in full
  AlbedoRow albedo;
  vec3 glass_tint;      // of refracted light
  vec3 glass_specular;  // scales the exact Fresnel reflectance
  float glass;          // weight of the interface; 0: none
  float glass_scale;    // makes up for light that a rough interface scatters more than once
  float eta;            // index of the far side over that of wo's side
  float alpha, alpha2;
  float diffuse_probability;  // of sampling by cosine
  bool coated;                // what is sampled by cosine depends on the albedo of wi
  bool delta;                 // the microfacet lobes are perfect mirrors
};

/// f(wo, wi) |cos|, split by lobe, and the density [1/sr] with which sample_bsdf takes wi. Delta
/// lobes are left out.
struct BsdfValue {
  vec3 diffuse{0};
  vec3 glossy{0};  // or transmission, for wi below the surface
  float pdf = 0;
};

enum class Lobe : u8 { kDiffuse, kGlossy, kTransmission };

struct BsdfSample {
  vec3 wi;             // unit, world
  vec3 weight{0};      // f |cos| / pdf
  vec3 diffuse_share;  // of the weight
  float pdf;           // 1/sr; 0: a delta lobe
  float eta;           // index of the far side over the near side when refracted, else 1
  Lobe lobe;
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

/// Colour of light that leaves rough microfacets after more than one scattering, per unit of energy
/// that single scattering loses; f_avg is the Fresnel reflectance averaged by cosine.
///
/// Source: Kulla and Conty 2017, "Revisiting Physically Based Shading at Imageworks".
KERNEL vec3 multiple_scattering(vec3 f_avg, float e_avg) {
  return f_avg * f_avg * e_avg / (vec3(1) - f_avg * (1 - e_avg));
}

KERNEL Albedo bsdf_albedo(const Bsdf& b, float cosine) {
  return b.delta ? Albedo{1, schlick_weight(cosine)} : albedo_at(b.albedo, cosine);
}

/// Share of light that the coat reflects.
KERNEL float coat_albedo(const Bsdf& b, Albedo a) {
  return b.coat_f0 * (a.total - a.schlick) + b.coat_f90 * a.schlick +
         b.coat_multiple * (1 - a.total);
}

/// The weights of the lobes, and the choice between them by their albedos.
KERNEL void set_lobes(Bsdf& b, const MaterialValues& m) {
  const float plastic = (1 - m.metallic) * (1 - m.transmission);
  const float f0_ior = sqr((m.ior - 1) / (m.ior + 1));
  const vec3 coat_f0 = glm::min(m.specular_color * f0_ior, vec3(1)) * m.specular;
  const float f_steps = 1 / 21.0f;  // the average of Schlick's weight
  const Albedo average = b.delta ? Albedo{1, f_steps} : albedo_average(m.roughness);
  const Albedo out = bsdf_albedo(b, b.wo.z);

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
  const float average_entering = 1 - coat_albedo(b, average);
  const vec3 diffuse = m.base_color * (plastic * entering);

  const float by_cosine = luminance(diffuse) + luminance(b.multiple) * lost;
  const float by_facets =
      luminance(b.f0) * (out.total - out.schlick) + b.f90 * out.schlick + b.glass;
  b.diffuse_probability = by_cosine > 0 ? by_cosine / (by_cosine + by_facets) : 0;
  b.diffuse = diffuse * (kInvPi / max2(average_entering, 1e-4f));
  b.multiple *= kInvPi * lost / max2(1 - average.total, 1e-4f);
}

/// wo      unit, world, leaves the surface
/// ng, ns  unit, world, of the front side
KERNEL Bsdf make_bsdf(const MaterialValues& m, vec3 wo, vec3 ng, vec3 ns) {
  const bool front = dot(wo, ng) >= 0;
  Bsdf b;
  b.ng = front ? ng : -ng;
  vec3 n = front ? ns : -ns;
  const bool facets = m.specular > 0 || m.metallic > 0 || m.transmission > 0;
  if (facets) n = bend_normal(b.ng, wo, n);
  b.frame = make_frame(n);
  b.wo = to_local(b.frame, wo);
  b.wo.z = max2(b.wo.z, 1e-4f);
  b.alpha = sqr(m.roughness);
  b.alpha2 = sqr(b.alpha);
  b.delta = b.alpha < kDeltaAlpha;
  b.glass = (1 - m.metallic) * m.transmission;
  if (!facets) {
    b.diffuse = m.base_color * kInvPi;
    b.multiple = b.f0 = vec3(0);
    b.f90 = 0;
    b.coated = false;
    b.diffuse_probability = 1;
    return b;
  }
  b.coated = true;
  if (!b.delta) b.albedo = albedo_row(kReflectionAlbedo, 2 * kAlbedoCosines, m.roughness);
  set_lobes(b, m);
  if (b.glass > 0) {
    // A rough interface of index 1 has no half vector: the smallest step that still has one.
    const float ior = b.delta ? m.ior : max2(m.ior, 1.01f);
    b.eta = front ? ior : 1 / ior;
    b.glass_tint =
        vec3(std::sqrt(m.base_color.x), std::sqrt(m.base_color.y), std::sqrt(m.base_color.z));
    b.glass_specular = glm::min(m.specular_color * m.specular, vec3(1));
    b.glass_scale = b.delta ? 1 : 1 / glass_albedo(b.wo.z, m.roughness, b.eta);
  }
  return b;
}

/// What a microfacet does with light at cosine c = wo.h.
struct Facet {
  vec3 reflected;
  vec3 transmitted;
  float cos_t;  // of the refracted direction
  float reflect_probability;
};
KERNEL Facet facet_of(const Bsdf& b, float c) {
  Facet f{b.f0 + (vec3(b.f90) - b.f0) * schlick_weight(c), vec3(0), 0, 1};
  if (b.glass <= 0) return f;
  const Fresnel exact = fresnel_dielectric(c, b.eta);
  const vec3 r = b.glass_specular * exact.reflectance;
  const float glass = b.glass * b.glass_scale;
  f.cos_t = exact.cos_t;
  if (exact.cos_t > 0) {
    f.reflected += r * glass;
    f.transmitted = b.glass_tint * (vec3(1) - r) * glass;
  } else {
    f.reflected += vec3(glass);
  }
  const float up = luminance(f.reflected);
  const float down = luminance(f.transmitted);
  f.reflect_probability = up + down > 0 ? up / (up + down) : 1;
  return f;
}

KERNEL void add_refraction(const Bsdf& b, vec3 wi, BsdfValue& out) {
  vec3 h = b.wo + wi * b.eta;
  h = normalize(h.z < 0 ? -h : h);
  const float wo_h = dot(b.wo, h);
  const float wi_h = dot(wi, h);
  if (wo_h <= 0 || wi_h >= 0) return;
  const Facet f = facet_of(b, wo_h);
  const float density = ggx_density(h, b.alpha2);
  const float jacobian = -wi_h / sqr(wi_h + wo_h / b.eta);
  const float lambda_o = ggx_lambda(b.wo.z * b.wo.z, b.alpha2);
  const float lambda_i = ggx_lambda(wi.z * wi.z, b.alpha2);
  // Walter et al. 2007, equation 21, over eta^2: radiance spreads or gathers as it refracts.
  const float value = density * wo_h * jacobian / (b.wo.z * (1 + lambda_o + lambda_i) * sqr(b.eta));
  out.glossy = f.transmitted * value;
  out.pdf = (1 - b.diffuse_probability) * (1 - f.reflect_probability) * jacobian * wo_h *
            ggx_visible_density(b.wo, density, b.alpha2);
}

KERNEL void add_reflection(const Bsdf& b, vec3 wi, BsdfValue& out) {
  const vec3 h = normalize(b.wo + wi);
  const Facet f = facet_of(b, dot(b.wo, h));
  const float density = ggx_density(h, b.alpha2);
  out.glossy += f.reflected * (ggx_reflection(b.wo, wi, density, b.alpha2) * wi.z);
  out.pdf += (1 - b.diffuse_probability) * f.reflect_probability * 0.25f *
             ggx_visible_density(b.wo, density, b.alpha2);
}

/// wi   unit, world
KERNEL BsdfValue evaluate_bsdf(const Bsdf& b, vec3 wi_world) {
  BsdfValue out;
  const vec3 wi = to_local(b.frame, wi_world);
  const float side = dot(b.ng, wi_world);
  if (wi.z <= 0) {
    if (wi.z < 0 && side < 0 && b.glass > 0 && !b.delta) add_refraction(b, wi, out);
    return out;
  }
  if (side <= 0) return out;
  if (b.diffuse_probability > 0) {
    out.diffuse = b.diffuse * wi.z;
    out.pdf = b.diffuse_probability * wi.z * kInvPi;
    if (b.coated) {
      const Albedo in = bsdf_albedo(b, wi.z);
      out.diffuse *= 1 - coat_albedo(b, in);
      out.glossy = b.multiple * (wi.z * max2(1 - in.total, 0.0f));
    }
  }
  if (b.diffuse_probability < 1 && !b.delta) add_reflection(b, wi, out);
  return out;
}

KERNEL vec3 share_of(vec3 part, vec3 total) {
  return vec3(total.x > 0 ? part.x / total.x : 0, total.y > 0 ? part.y / total.y : 0,
              total.z > 0 ? part.z / total.z : 0);
}

/// The weight and density of a direction that has been chosen.
KERNEL bool finish_sample(const Bsdf& b, BsdfSample& s) {
  const BsdfValue value = evaluate_bsdf(b, s.wi);
  if (!(value.pdf > 0)) return false;
  const vec3 total = value.diffuse + value.glossy;
  s.pdf = value.pdf;
  s.weight = total / value.pdf;
  s.diffuse_share = share_of(value.diffuse, total);
  return true;
}

/// Reflects from or refracts through a microfacet. u: for the choice between the two.
KERNEL bool sample_facet(const Bsdf& b, float u, vec3 h, BsdfSample& s) {
  const float wo_h = dot(b.wo, h);
  if (wo_h <= 0) return false;
  const Facet f = facet_of(b, wo_h);
  const bool reflect = u < f.reflect_probability;
  const vec3 wi =
      reflect ? h * (2 * wo_h) - b.wo : h * (wo_h / b.eta - f.cos_t) - b.wo * (1 / b.eta);
  if (reflect != (wi.z > 0)) return false;
  s.wi = to_world(b.frame, wi);
  s.lobe = reflect ? Lobe::kGlossy : Lobe::kTransmission;
  s.eta = reflect ? 1 : b.eta;
  if (!b.delta) return finish_sample(b, s);
  if (dot(s.wi, b.ng) * (reflect ? 1.0f : -1.0f) <= 0) return false;
  const float facets = 1 - b.diffuse_probability;
  s.pdf = 0;
  s.diffuse_share = vec3(0);
  s.weight = reflect ? f.reflected / (f.reflect_probability * facets)
                     : f.transmitted / ((1 - f.reflect_probability) * facets * sqr(b.eta));
  return true;
}

/// Chooses a direction; false when light from there counts for nothing.
///
/// u_lobe, u   uniform in [0, 1)
KERNEL bool sample_bsdf(const Bsdf& b, float u_lobe, vec2 u, BsdfSample& s) {
  if (u_lobe < b.diffuse_probability) {
    s.wi = to_world(b.frame, sample_cosine(u));
    s.lobe = Lobe::kDiffuse;
    s.eta = 1;
    return finish_sample(b, s);
  }
  const float rest = (u_lobe - b.diffuse_probability) / (1 - b.diffuse_probability);
  return sample_facet(b, rest, b.delta ? vec3(0, 0, 1) : sample_ggx(b.wo, b.alpha, u), s);
}

/// Whether the surface sends on any light at all.
KERNEL bool scatters(const Bsdf& b) {
  return b.glass > 0 || b.f90 > 0 || !is_black(b.diffuse) || !is_black(b.f0);
}

/// Whether lights are worth sampling: something is not a perfect mirror.
KERNEL bool has_smooth_lobe(const Bsdf& b) { return b.diffuse_probability > 0 || !b.delta; }

}  // namespace heliograph::kernels::inline HELIO_ISA
