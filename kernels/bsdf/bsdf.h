// How a surface scatters light: the principled material, a base under sheen and clearcoat. Called
// by path.h.
//
// Source of the parameters: Burley 2012, "Physically-Based Shading at Disney", and 2015, "Extending
// the Disney BRDF to a BSDF with Integrated Subsurface Scattering"; glTF 2.0 and its extensions.
#pragma once

#include "kernels/bsdf/layers.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A material at a point, seen from direction wo.
struct Bsdf : Base {
  bool layered;
  Layers layers;  // set where there are any
};

KERNEL bool is_layered(const Bsdf& b) { return kRich && b.layered; }

/// In place: a Bsdf is large, and most of it stays unset where there are no layers.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL void set_bsdf(Bsdf& b, const MaterialValues& m,
                                                     const ShadingPoint& at) {
  const bool front = dot(at.wo, at.ng) >= 0;
  b.ng = front ? at.ng : -at.ng;
  set_base(b, m, at, front ? at.ns : -at.ns);
  b.layered = has_layers(m);
  if (is_layered(b)) {
    set_layers(b.layers, b, m, at.wo, front ? at.clearcoat_normal : -at.clearcoat_normal);
  }
}
KERNEL Bsdf make_bsdf(const MaterialValues& m, const ShadingPoint& at) {
  Bsdf b;
  set_bsdf(b, m, at);
  return b;
}

/// wi   unit, world
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL BsdfValue evaluate_bsdf(const Bsdf& b, vec3 wi_world) {
  const vec3 wi = to_local(b.frame, wi_world);
  const float side = dot(b.ng, wi_world);
  BsdfValue out = evaluate_base(b, wi, side);
  if (!is_layered(b)) return out;
  const Layers& l = b.layers;
  out.glossy *= l.below;
  out.pdf *= l.base_probability;
  if (side <= 0) return out;
  if (!is_black(out.diffuse)) {
    const float coat_cosine = l.clearcoat > 0 ? dot(l.coat.n, wi_world) : 0;
    out.diffuse *= layers_transmit(l, coat_cosine, wi.z);
  }
  add_layers(l, b, wi, wi_world, out);
  return out;
}

KERNEL vec3 share_of(vec3 part, vec3 total) {
  return vec3(total.x > 0 ? part.x / total.x : 0, total.y > 0 ? part.y / total.y : 0,
              total.z > 0 ? part.z / total.z : 0);
}

/// The weight and density of a direction that has been chosen.
KERNEL bool finish_sample(const Bsdf& b, Chosen chosen, BsdfSample& s) {
  if (!chosen.valid) return false;
  if (chosen.delta) {
    s.pdf = 0;
    return true;
  }
  const BsdfValue value = evaluate_bsdf(b, s.wi);
  if (!(value.pdf > 0)) return false;
  const float scale = 1 / value.pdf;
  s.pdf = value.pdf;
  s.weight = (value.diffuse + value.glossy) * scale;
  s.diffuse = value.diffuse * scale;
  return true;
}

KERNEL bool sample_layered(const Bsdf& b, float u_lobe, vec2 u, BsdfSample& s) {
  const Layers& l = b.layers;
  if (u_lobe < l.base_probability) {
    const Chosen chosen = choose_base(b, u_lobe / l.base_probability, u, s);
    if (chosen.delta) s.weight *= l.below / l.base_probability;
    return finish_sample(b, chosen, s);
  }
  const bool clearcoat = u_lobe - l.base_probability < l.clearcoat_probability;
  return finish_sample(b, clearcoat ? choose_clearcoat(l, b, u, s) : choose_sheen(b, u, s), s);
}

/// Chooses a direction; false when light from there counts for nothing.
///
/// u_lobe, u   uniform in [0, 1)
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL bool sample_bsdf(const Bsdf& b, float u_lobe, vec2 u,
                                                        BsdfSample& s) {
  return is_layered(b) ? sample_layered(b, u_lobe, u, s)
                       : finish_sample(b, choose_base(b, u_lobe, u, s), s);
}

/// Whether sample_bsdf() looks at u_lobe.
KERNEL bool chooses_lobe(const Bsdf& b) { return is_layered(b) || b.diffuse_probability < 1; }

/// Light from inside the body leaves towards wi (unit, world) with this times the cosine / pi.
KERNEL float leaving_body(const Bsdf& b, vec3 wi_world) {
  const vec3 wi = to_local(b.frame, wi_world);
  if (wi.z <= 0 || dot(b.ng, wi_world) <= 0) return 0;
  float leaving = b.coated ? 1 - coat_albedo(b, base_albedo(b, wi)) : 1;
  if (is_layered(b)) {
    const float coat_cosine = b.layers.clearcoat > 0 ? dot(b.layers.coat.n, wi_world) : 0;
    leaving *= layers_transmit(b.layers, coat_cosine, wi.z);
  }
  return leaving / b.average_entering;
}

/// Whether the surface sends on any light at all.
KERNEL bool scatters(const Bsdf& b) {
  return b.glass > 0 || b.f90 > 0 || b.subsurface > 0 || !is_black(b.diffuse) || !is_black(b.f0) ||
         is_layered(b);
}

/// Whether lights are worth sampling: something is not a perfect mirror.
KERNEL bool has_smooth_lobe(const Bsdf& b) {
  return b.diffuse_probability > 0 || !b.delta || (passes_apart(b) && !b.through_delta) ||
         (is_layered(b) && (b.layers.sheen_weight > 0 || !b.layers.delta));
}

}  // namespace heliograph::kernels::inline HELIO_ISA
