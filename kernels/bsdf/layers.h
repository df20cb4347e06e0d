// Layers on the base: sheen, and clearcoat on top of it. Called by bsdf.h.
#pragma once

#include "kernels/bsdf/base_lobes.h"
#include "kernels/bsdf/sheen.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Reflectance of clearcoat at normal incidence: that of index 1.5.
inline constexpr float kClearcoatF0 = 0.04f;

/// A layer gives off its albedo and lets the rest in: the light of what lies below is scaled by
/// what the layers let out towards wo. Of the diffuse light, which is reciprocal in itself, it is
/// the product of what they let in and out.
template <class F>
struct LayersOf {
  FrameOf<F> coat;  // z: the clearcoat's normal on wo's side
  Vec3<F> coat_wo;
  GgxOf<F> facets;
  AlbedoRowOf<F> albedo;
  F clearcoat;
  SheenOf<F> sheen;
  Vec3<F> sheen_color;
  F sheen_weight;                             // largest component of the colour
  F below_clearcoat;                          // share of light that the clearcoat lets out to wo
  F below;                                    // the same of both layers
  F base_probability, clearcoat_probability;  // of sampling; what is left: sheen
  BoolOf<F> delta;                            // the clearcoat is a perfect mirror
};

template <class F>
KERNEL BoolOf<F> has_layers(const MaterialValuesOf<F>& m) {
  return rich<kFeatures>((m.clearcoat > 0) | ((m.sheen > 0) & !is_black(m.sheen_color)));
}

/// True for a material that scatters no light, as one that only emits.
KERNEL bool is_black(const MaterialValues& m) {
  return !(m.specular > 0 || m.metallic > 0 || m.transmission > 0 || m.subsurface > 0 ||
           m.diffuse_transmission > 0 || has_layers(m)) &&
         is_black(m.base_color);
}

template <class F>
KERNEL F clearcoat_albedo(const LayersOf<F>& l, F cosine) {
  return either(
      l.clearcoat > 0,
      [&] {
        const AlbedoOf<F> a = either(
            l.delta, [&] { return AlbedoOf<F>{F(1), schlick_weight(cosine)}; },
            [&] { return albedo_at(l.albedo, max2(cosine, F(0))); });
        return F(l.clearcoat * (kClearcoatF0 * (a.total - a.schlick) + a.schlick));
      },
      [] { return F(0); });
}

/// Share of light that sheen reflects to a cosine.
template <class F>
KERNEL F sheen_share(const LayersOf<F>& l, F cosine) {
  return either(
      l.sheen_weight > 0, [&] { return F(l.sheen_weight * sheen_albedo(l.sheen, cosine)); },
      [] { return F(0); });
}

/// Share of light that passes both layers in a direction at these cosines to their normals.
template <class F>
KERNEL F layers_transmit(const LayersOf<F>& l, F clearcoat_cosine, F sheen_cosine) {
  return (1 - clearcoat_albedo(l, clearcoat_cosine)) * (1 - sheen_share(l, sheen_cosine));
}

/// Average by cosine of what enters the layers and then the base's coat.
template <class F, Features S>
KERNEL F average_entering(const LayersOf<F>& l, const BaseOf<F, S>& b) {
  // Gauss-Legendre with 5 points over the square root of the cosine, in which the tables run.
  const float places[5] = {0.04691008f, 0.23076534f, 0.5f, 0.76923466f, 0.95308992f};
  const float weights[5] = {0.11846344f, 0.23931434f, 0.28444444f, 0.23931434f, 0.11846344f};
  F sum = 0;
  for (u32 i = 0; i < 5; ++i) {
    const float cosine = sqr(places[i]);
    const float sine = 0.70710678f * safe_sqrt(1 - sqr(cosine));
    F entering = layers_transmit(l, F(cosine), F(cosine));
    if (any(b.coated)) {
      const Vec3<F> wi(sine, sine, cosine);
      entering *= select(b.coated, 1 - coat_albedo(b, base_albedo(b, wi)), F(1));
    }
    sum += weights[i] * 4 * places[i] * cosine * entering;
  }
  return max2(sum, F(1e-4f));
}

/// The clearcoat of a material; n: its normal on wo's side.
template <class F, Features S>
KERNEL void set_clearcoat(LayersOf<F>& l, const BaseOf<F, S>& b, const MaterialValuesOf<F>& m,
                          Vec3<F> wo, Vec3<F> n) {
  const BoolOf<F> coated = m.clearcoat > 0;
  l.clearcoat = m.clearcoat;
  l.coat_wo = Vec3<F>(0);
  l.delta = false;
  if (!any(coated)) return;
  l.coat = make_frame(bend_normal(b.ng, wo, n));
  l.coat_wo = to_local(l.coat, wo);
  l.coat_wo.z = select(coated, max2(l.coat_wo.z, F(1e-4f)), F(0));
  const F alpha = sqr(m.clearcoat_roughness);
  l.facets = {alpha, alpha};
  l.delta = coated & (alpha < kDeltaAlpha);
  l.albedo = albedo_row(m.clearcoat_roughness);
}

template <class F>
KERNEL void set_sheen(LayersOf<F>& l, const MaterialValuesOf<F>& m) {
  Vec3<F> color = m.sheen_color * m.sheen;
  if (const auto tinted = m.sheen_tint > 0; any(tinted)) {
    const Vec3<F> tint = min3(tint_of(m.base_color), Vec3<F>(1));
    color *= select(tinted, Vec3<F>(1) + (tint - Vec3<F>(1)) * m.sheen_tint, Vec3<F>(1));
  }
  l.sheen_color = min3(color, Vec3<F>(1));
  l.sheen_weight = max_component(l.sheen_color);
  if (any(l.sheen_weight > 0)) l.sheen = make_sheen(m.sheen_roughness);
}

/// Puts layers on a base, where it has some; n: the clearcoat's normal on wo's side.
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL void set_layers(LayersOf<F>& l, BaseOf<F, S>& b, BoolOf<F> layered,
                                          const MaterialValuesOf<F>& m, Vec3<F> wo, Vec3<F> n) {
  set_clearcoat(l, b, m, wo, n);
  set_sheen(l, m);
  const F clearcoat = clearcoat_albedo(l, l.coat_wo.z);
  l.below_clearcoat = 1 - clearcoat;
  l.below = layers_transmit(l, l.coat_wo.z, b.wo.z);
  const F average = average_entering(l, b);
  const F below = select(layered, l.below * b.average_entering / average, F(1));
  b.diffuse *= below;
  b.diffuse_through *= below;
  b.average_entering = select(layered, average, b.average_entering);

  const F sheen = either(
      l.sheen_weight > 0,
      [&] {
        return F(l.below_clearcoat * luminance(l.sheen_color) * sheen_albedo(l.sheen, b.wo.z));
      },
      [] { return F(0); });
  const F base = l.below * b.reflectance;
  const F sum = base + clearcoat + sheen;
  l.base_probability = select(sum > 0, base / sum, F(1));
  l.clearcoat_probability = select(sheen > 0, clearcoat / sum, 1 - l.base_probability);
}

template <class F>
KERNEL F sheen_probability(const LayersOf<F>& l) {
  return select(l.sheen_weight > 0, max2(1 - l.base_probability - l.clearcoat_probability, F(0)),
                F(0));
}

template <class F>
KERNEL F clearcoat_fresnel(const LayersOf<F>& l, F c) {
  return l.clearcoat * (kClearcoatF0 + (1 - kClearcoatF0) * schlick_weight(c));
}

/// Adds what the layers reflect to wi, which lies above the surface and is local to the base.
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL void add_layers(const LayersOf<F>& l, const BaseOf<F, S>& b, Vec3<F> wi,
                                          Vec3<F> wi_world, BsdfValueOf<F>& out) {
  const Vec3<F> none(0);
  if (const auto sheen = (l.sheen_weight > 0) & (wi.z > 0); any(sheen)) {
    const F reflected = l.below_clearcoat * sheen_reflection(l.sheen, b.wo, wi);
    out.diffuse += select(sheen, l.sheen_color * reflected, none);
    out.pdf += select(sheen, sheen_probability(l) * (0.5f * kInvPi), F(0));
  }
  const BoolOf<F> smooth = (l.clearcoat > 0) & !l.delta;
  if (!any(smooth)) return;
  const Vec3<F> coat_wi = to_local(l.coat, wi_world);
  const BoolOf<F> above = smooth & (coat_wi.z > 0);
  if (!any(above)) return;
  const Vec3<F> h = normalize(l.coat_wo + coat_wi);
  const F density = ggx_density(h, l.facets);
  const F glossy = clearcoat_fresnel(l, F(dot(l.coat_wo, h))) *
                   ggx_reflection(l.coat_wo, coat_wi, density, l.facets) * coat_wi.z;
  const F pdf = l.clearcoat_probability * 0.25f * ggx_visible_density(l.coat_wo, density, l.facets);
  out.glossy += select(above, Vec3<F>(glossy), none);
  out.pdf += select(above, pdf, F(0));
}

/// Reflects from the clearcoat.
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL ChosenOf<F> choose_clearcoat(const LayersOf<F>& l, const BaseOf<F, S>& b,
                                                       Vec2<F> u, BsdfSampleOf<F>& s) {
  const Vec3<F> h = either(
      l.delta, [] { return Vec3<F>(0, 0, 1); }, [&] { return sample_ggx(l.coat_wo, l.facets, u); });
  const F wo_h = dot(l.coat_wo, h);
  const Vec3<F> wi = h * (2 * wo_h) - l.coat_wo;
  s.wi = to_world(l.coat, wi);
  s.lobe = Lobe::kGlossy;
  s.weight = Vec3<F>(clearcoat_fresnel(l, wo_h) / l.clearcoat_probability);
  const BoolOf<F> valid = (wo_h > 0) & (wi.z > 0) & (dot(s.wi, b.ng) > 0);
  return {valid, l.delta};
}

/// Uniform over the hemisphere, which bounds the weight: the reflection times the cosine is finite.
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL ChosenOf<F> choose_sheen(const BaseOf<F, S>& b, Vec2<F> u,
                                                   BsdfSampleOf<F>& s) {
  const F r = safe_sqrt(1 - u.x * u.x);
  const SinCosOf<F> phi = sincos_turns(u.y);
  s.wi = to_world(b.frame, Vec3<F>(r * phi.cos, r * phi.sin, u.x));
  s.lobe = Lobe::kDiffuse;
  return {true, false};
}

}  // namespace heliograph::kernels::inline HELIO_ISA
