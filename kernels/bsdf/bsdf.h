// How a surface scatters light: the principled material, a base under sheen and clearcoat. Called
// by path.h.
//
// Source of the parameters: Burley 2012, "Physically-Based Shading at Disney", and 2015, "Extending
// the Disney BRDF to a BSDF with Integrated Subsurface Scattering"; glTF 2.0 and its extensions.
#pragma once

#include "kernels/bsdf/layers.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A material at a point, seen from direction wo.
template <class F, Features S = kFeatures>
struct BsdfOf : BaseOf<F, S> {
  BoolOf<F> layered;
  LayersOf<F> layers;  // set where there are any
};
using Bsdf = BsdfOf<float>;

template <class F, Features S>
KERNEL BoolOf<F> is_layered(const BsdfOf<F, S>& b) {
  return rich<S>(b.layered);
}

/// In place: a Bsdf is large, and most of it stays unset where there are no layers.
template <class F, Features S>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL void set_bsdf(BsdfOf<F, S>& b, const MaterialValuesOf<F>& m,
                                                     const ShadingPointOf<F>& at) {
  const BoolOf<F> front = dot(at.wo, at.ng) >= 0;
  b.ng = select(front, at.ng, -at.ng);
  set_base(b, m, at, select(front, at.ns, -at.ns));
  b.layered = rich<S>(has_layers(m));
  if (any(is_layered(b))) {
    const Vec3<F> n = select(front, at.clearcoat_normal, -at.clearcoat_normal);
    set_layers(b.layers, b, b.layered, m, at.wo, n);
  }
}
KERNEL Bsdf make_bsdf(const MaterialValues& m, const ShadingPoint& at) {
  Bsdf b;
  set_bsdf(b, m, at);
  return b;
}

/// Share of light from wi that comes through the layers: those of the far face, which are the same,
/// where wi lies below the surface. wi: local and world
template <class F>
HELIO_ALWAYS_INLINE KERNEL F entering_layers(const LayersOf<F>& l, Vec3<F> wi, Vec3<F> wi_world) {
  const BoolOf<F> below = wi.z < 0;
  const F coat_cosine =
      either(l.clearcoat > 0, [&] { return F(dot(l.coat.n, wi_world)); }, [] { return F(0); });
  return layers_transmit(l, F(select(below, -coat_cosine, coat_cosine)), F(abs(wi.z)));
}

/// wi   unit, world
template <class F, Features S>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL BsdfValueOf<F> evaluate_bsdf(const BsdfOf<F, S>& b,
                                                                    Vec3<F> wi_world) {
  const Vec3<F> wi = to_local(b.frame, wi_world);
  const F side = dot(b.ng, wi_world);
  BsdfValueOf<F> out = evaluate_base(b, wi, side);
  const BoolOf<F> layered = is_layered(b);
  if (!any(layered)) return out;
  const LayersOf<F>& l = b.layers;
  out.glossy *= select(layered, l.below, F(1));
  out.pdf *= select(layered, l.base_probability, F(1));
  if (const auto diffuse = layered & !is_black(out.diffuse); any(diffuse))
    out.diffuse *= select(diffuse, entering_layers(l, wi, wi_world), F(1));
  const BoolOf<F> above = layered & (side > 0);
  if (!any(above)) return out;
  BsdfValueOf<F> all_layers = out;
  add_layers(l, b, wi, wi_world, all_layers);
  return select(above, all_layers, out);
}

KERNEL vec3 share_of(vec3 part, vec3 total) {
  return vec3(total.x > 0 ? part.x / total.x : 0, total.y > 0 ? part.y / total.y : 0,
              total.z > 0 ? part.z / total.z : 0);
}

/// The weights and densities of directions that have been chosen. Returns which count.
template <class F, Features S>
KERNEL BoolOf<F> finish_sample(const BsdfOf<F, S>& b, const ChosenOf<F>& chosen,
                               BsdfSampleOf<F>& s) {
  const BoolOf<F> smooth = chosen.valid & !chosen.delta;
  if (!any(smooth)) {
    s.pdf = F(0);
    return chosen.valid;
  }
  const BsdfValueOf<F> value = evaluate_bsdf(b, s.wi);
  const F scale = 1 / value.pdf;
  s.pdf = select(smooth, value.pdf, F(0));
  s.weight = select(smooth, (value.diffuse + value.glossy) * scale, s.weight);
  s.diffuse = select(smooth, value.diffuse * scale, s.diffuse);
  return chosen.valid & (chosen.delta | (value.pdf > 0));
}

/// Chooses directions of layered surfaces. Returns which; the others are left as they are.
template <class F, Features S>
KERNEL ChosenOf<F> choose_layered(const BsdfOf<F, S>& b, F u_lobe, Vec2<F> u, BsdfSampleOf<F>& s) {
  const LayersOf<F>& l = b.layers;
  const BoolOf<F> layered = is_layered(b);
  const BoolOf<F> base = (!layered) | (u_lobe < l.base_probability);
  ChosenOf<F> chosen{true, false};
  if (any(base)) {
    const F rest = select(layered, u_lobe / l.base_probability, u_lobe);
    chosen = choose_base(b, rest, u, s);
    const F below = select(layered & chosen.delta, l.below / l.base_probability, F(1));
    s.weight *= below;
  }
  if (all(base)) return chosen;
  const BoolOf<F> clearcoat = (u_lobe - l.base_probability) < l.clearcoat_probability;
  BsdfSampleOf<F> of_layer, of_sheen;
  ChosenOf<F> layer{true, false};
  if (any(clearcoat)) layer = choose_clearcoat(l, b, u, of_layer);
  if (!all(clearcoat)) {
    const ChosenOf<F> sheen = choose_sheen(b, u, of_sheen);
    of_layer = select(clearcoat, of_layer, of_sheen);
    layer = select(clearcoat, layer, sheen);
  }
  s = select(base, s, of_layer);
  return select(base, chosen, layer);
}

/// Chooses a direction; false when light from there counts for nothing.
///
/// u_lobe, u   uniform in [0, 1)
template <class F, Features S>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL BoolOf<F> sample_bsdf(const BsdfOf<F, S>& b, F u_lobe,
                                                             Vec2<F> u, BsdfSampleOf<F>& s) {
  const ChosenOf<F> chosen =
      any(is_layered(b)) ? choose_layered(b, u_lobe, u, s) : choose_base(b, u_lobe, u, s);
  return finish_sample(b, chosen, s);
}

/// True where sample_bsdf() looks at u_lobe.
template <class F, Features S>
KERNEL BoolOf<F> chooses_lobe(const BsdfOf<F, S>& b) {
  const BoolOf<F> layered = is_layered(b), translucent = is_translucent(b);
  return layered | translucent | (b.diffuse_probability < 1);
}

/// Light from inside the body leaves towards wi (unit, world) with this times the cosine / pi.
KERNEL float leaving_body(const Bsdf& b, vec3 wi_world) {
  const vec3 wi = to_local(b.frame, wi_world);
  if (wi.z <= 0 || dot(b.ng, wi_world) <= 0) return 0;
  float leaving = b.coated ? 1 - coat_albedo(b, base_albedo(b, wi)) : 1;
  if (is_layered(b)) leaving *= entering_layers(b.layers, wi, wi_world);
  return leaving / b.average_entering;
}

/// True where the surface sends on any light at all.
template <class F, Features S>
KERNEL BoolOf<F> scatters(const BsdfOf<F, S>& b) {
  const BoolOf<F> glass = is_glass(b), layered = is_layered(b);
  const BoolOf<F> diffuse = !is_black(b.diffuse), metal = !is_black(b.f0);
  return glass | layered | diffuse | metal | is_translucent(b) | (b.f90 > 0) | (b.subsurface > 0);
}

/// True where lights are worth sampling: something is not a perfect mirror.
template <class F, Features S>
KERNEL BoolOf<F> has_smooth_lobe(const BsdfOf<F, S>& b) {
  BoolOf<F> smooth = (b.diffuse_probability > 0) | !is_mirror(b);
  if (const auto apart = passes_apart(b); any(apart)) smooth = smooth | (apart & !b.through_delta);
  if (const auto layered = is_layered(b); any(layered))
    smooth = smooth | (layered & ((b.layers.sheen_weight > 0) | !b.layers.delta));
  return smooth;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
