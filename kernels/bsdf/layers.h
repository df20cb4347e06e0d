// What lies on the base: sheen, and clearcoat on top of it. Called by bsdf.h.
#pragma once

#include "kernels/bsdf/base_lobes.h"
#include "kernels/bsdf/sheen.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Reflectance of clearcoat at normal incidence: that of index 1.5.
inline constexpr float kClearcoatF0 = 0.04f;

/// A layer gives off its albedo and lets the rest in: the light of what lies below is scaled by
/// what the layers let out towards wo. Of the diffuse light, which is reciprocal in itself, it is
/// the product of what they let in and out.
struct Layers {
  Frame coat;  // z: the clearcoat's normal on wo's side
  vec3 coat_wo;
  Ggx facets;
  AlbedoRow albedo;
  float clearcoat;
  Sheen sheen;
  vec3 sheen_color;
  float sheen_weight;     // largest component of the colour
  float below_clearcoat;  // share of light that the clearcoat lets out to wo
  float below;            // the same of both layers
  float base_probability, clearcoat_probability;  // of sampling; what is left: sheen
  bool delta;                                     // the clearcoat is a perfect mirror
};

KERNEL bool has_layers(const MaterialValues& m) {
  return kRich && (m.clearcoat > 0 || (m.sheen > 0 && !is_black(m.sheen_color)));
}

KERNEL float clearcoat_albedo(const Layers& l, float cosine) {
  if (!(l.clearcoat > 0)) return 0;
  const Albedo a =
      l.delta ? Albedo{1, schlick_weight(cosine)} : albedo_at(l.albedo, max2(cosine, 0.0f));
  return l.clearcoat * (kClearcoatF0 * (a.total - a.schlick) + a.schlick);
}

/// Share of light that passes both layers in a direction at these cosines to their normals.
KERNEL float layers_transmit(const Layers& l, float clearcoat_cosine, float sheen_cosine) {
  const float sheen = l.sheen_weight > 0 ? l.sheen_weight * sheen_albedo(l.sheen, sheen_cosine) : 0;
  return (1 - clearcoat_albedo(l, clearcoat_cosine)) * (1 - sheen);
}

/// Average by cosine of what enters the layers and then the base's coat.
KERNEL float average_entering(const Layers& l, const Base& b) {
  // Gauss-Legendre with 5 points over the square root of the cosine, in which the tables run.
  const float places[5] = {0.04691008f, 0.23076534f, 0.5f, 0.76923466f, 0.95308992f};
  const float weights[5] = {0.11846344f, 0.23931434f, 0.28444444f, 0.23931434f, 0.11846344f};
  float sum = 0;
  for (u32 i = 0; i < 5; ++i) {
    const float cosine = sqr(places[i]);
    const float sine = 0.70710678f * safe_sqrt(1 - sqr(cosine));
    float entering = layers_transmit(l, cosine, cosine);
    if (b.coated) entering *= 1 - coat_albedo(b, base_albedo(b, vec3(sine, sine, cosine)));
    sum += weights[i] * 4 * places[i] * cosine * entering;
  }
  return max2(sum, 1e-4f);
}

/// Puts layers on a base; n: the clearcoat's normal on wo's side.
HELIO_GPU_NOINLINE KERNEL void set_layers(Layers& l, Base& b, const MaterialValues& m, vec3 wo,
                                          vec3 n) {
  l.clearcoat = m.clearcoat;
  if (l.clearcoat > 0) {
    l.coat = make_frame(bend_normal(b.ng, wo, n));
    l.coat_wo = to_local(l.coat, wo);
    l.coat_wo.z = max2(l.coat_wo.z, 1e-4f);
    const float alpha = sqr(m.clearcoat_roughness);
    l.facets = {alpha, alpha};
    l.delta = alpha < kDeltaAlpha;
    l.albedo = albedo_row(m.clearcoat_roughness);
  } else {
    l.coat_wo.z = 0;
    l.delta = false;
  }
  vec3 color = m.sheen_color * m.sheen;
  if (m.sheen_tint > 0) {
    const vec3 tint = glm::min(tint_of(m.base_color), vec3(1));
    color *= vec3(1) + (tint - vec3(1)) * m.sheen_tint;
  }
  l.sheen_color = glm::min(color, vec3(1));
  l.sheen_weight = max_component(l.sheen_color);
  if (l.sheen_weight > 0) l.sheen = make_sheen(m.sheen_roughness);

  const float clearcoat = clearcoat_albedo(l, l.coat_wo.z);
  l.below_clearcoat = 1 - clearcoat;
  l.below = layers_transmit(l, l.coat_wo.z, b.wo.z);
  const float average = average_entering(l, b);
  b.diffuse *= l.below * b.average_entering / average;
  b.average_entering = average;

  const float sheen = l.sheen_weight > 0 ? l.below_clearcoat * luminance(l.sheen_color) *
                                               sheen_albedo(l.sheen, b.wo.z)
                                         : 0;
  const float base = l.below * b.reflectance;
  const float sum = base + clearcoat + sheen;
  l.base_probability = sum > 0 ? base / sum : 1;
  l.clearcoat_probability = sheen > 0 ? clearcoat / sum : 1 - l.base_probability;
}

KERNEL float sheen_probability(const Layers& l) {
  return l.sheen_weight > 0 ? max2(1 - l.base_probability - l.clearcoat_probability, 0.0f) : 0;
}

KERNEL float clearcoat_fresnel(const Layers& l, float c) {
  return l.clearcoat * (kClearcoatF0 + (1 - kClearcoatF0) * schlick_weight(c));
}

/// Adds what the layers reflect to wi, which lies above the surface and is local to the base.
HELIO_GPU_NOINLINE KERNEL void add_layers(const Layers& l, const Base& b, vec3 wi, vec3 wi_world,
                                          BsdfValue& out) {
  if (l.sheen_weight > 0 && wi.z > 0) {
    out.diffuse += l.sheen_color * (l.below_clearcoat * sheen_reflection(l.sheen, b.wo, wi));
    out.pdf += sheen_probability(l) * (0.5f * kInvPi);
  }
  if (!(l.clearcoat > 0) || l.delta) return;
  const vec3 coat_wi = to_local(l.coat, wi_world);
  if (coat_wi.z <= 0) return;
  const vec3 h = normalize(l.coat_wo + coat_wi);
  const float density = ggx_density(h, l.facets);
  out.glossy += vec3(clearcoat_fresnel(l, dot(l.coat_wo, h)) *
                     ggx_reflection(l.coat_wo, coat_wi, density, l.facets) * coat_wi.z);
  out.pdf += l.clearcoat_probability * 0.25f * ggx_visible_density(l.coat_wo, density, l.facets);
}

/// Reflects from the clearcoat.
HELIO_GPU_NOINLINE KERNEL Chosen choose_clearcoat(const Layers& l, const Base& b, vec2 u,
                                                  BsdfSample& s) {
  const vec3 h = l.delta ? vec3(0, 0, 1) : sample_ggx(l.coat_wo, l.facets, u);
  const float wo_h = dot(l.coat_wo, h);
  const vec3 wi = h * (2 * wo_h) - l.coat_wo;
  s.wi = to_world(l.coat, wi);
  s.lobe = Lobe::kGlossy;
  s.eta = 1;
  s.weight = vec3(clearcoat_fresnel(l, wo_h) / l.clearcoat_probability);
  return {wo_h > 0 && wi.z > 0 && dot(s.wi, b.ng) > 0, l.delta};
}

/// Uniform over the hemisphere, which bounds the weight: the reflection times the cosine is finite.
HELIO_GPU_NOINLINE KERNEL Chosen choose_sheen(const Base& b, vec2 u, BsdfSample& s) {
  const float r = safe_sqrt(1 - u.x * u.x);
  const SinCos phi = sincos_turns(u.y);
  s.wi = to_world(b.frame, vec3(r * phi.cos, r * phi.sin, u.x));
  s.lobe = Lobe::kDiffuse;
  s.eta = 1;
  return {true, false};
}

}  // namespace heliograph::kernels::inline HELIO_ISA
