// Vertices that paths have come to, side by side, where the surface is plain: opaque coat and metal
// under microfacets, nothing on it or in it. Called by lockstep.h.
#pragma once

#include "kernels/core/lanes.h"
#include "kernels/schedule/later.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Whether a surface that a path has come to is plain.
KERNEL bool is_plain(const Vertex& v) {
  const MaterialValues& m = v.material;
  if (v.surface.material->unlit || m.transmission > 0 || m.subsurface > 0 || m.anisotropic > 0 ||
      m.iridescence > 0 || has_layers(m)) {
    return false;
  }
  const bool facets = m.specular > 0 || m.metallic > 0;
  return facets ? sqr(m.roughness) >= kDeltaAlpha : !is_black(m.base_color);
}

/// Up to kLanes of them. Lanes beyond those that were added hold numbers, which mean nothing.
struct PlainVertices {
  u32 count = 0;

  // what was met
  Row3 wo, ng, n;  // unit, world, on wo's side; n: shading normal
  Row3 base_color, coat_f0;
  Row specular, metallic, roughness;
  Row3 p;
  Row offset;  // Surface::offset
  // the paths
  Row3 throughput;
  Row radiance_scale;
  Row light_u, light_v, scatter_u, scatter_v, lobe_u, chance_u;  // uniform in [0, 1)
  Row ends_by_chance;                                            // 1: roulette has begun
  Row looks;                                                     // 1: for casters
  // light, one way or the other: where it is, and how often it is taken
  Row surface_share;          // Receiver::surface_share
  LightSample light[kLanes];  // of plain lights `light` alone
  Row3 light_direction, light_target;
  Row light_near;                 // 1: it has a target, 0: it is infinitely far away
  Row light_pdf;                  // 0: there is none
  Row diffuse_sees, glossy_sees;  // 1 or 0
  Row weighed;                    // 1: multiple importance sampling counts it; 0: nothing else does
  bool any_looks = false;
  CasterConesOf<Floats> casters;  // where any vertex looks for them

  // what becomes of them: bit i is lane i
  u32 lit;                          // light may come along
  Row3 ray_origin, ray_direction;   // this ray
  Row ray_end;                      // Ray::t_max
  Row3 light_total, light_diffuse;  // f |cos| of it, and what of that is diffuse
  Row3 light_seen;                  // throughput times that
  Row light_weight;                 // of the strategy, over its density
  u32 survive;                      // it goes on
  u32 glossy;                       // by microfacets
  Row3 own_weight;                  // BsdfSample::weight of the surface's own choice; 0: none
  Row3 weight, diffuse_weight;      // BsdfSample::weight, diffuse
  Row3 origin, direction;
  Row pdf;
};

/// Adds a vertex to those that are fewer than kLanes.
///
/// light   whether sample_lights() finds its light; if not it is sampled here
template <Tracer T>
KERNEL void add(PlainVertices& all, const PathContext<T>& c, const Path& path, const Vertex& v,
                bool light) {
  const u32 i = all.count++;
  const Surface& s = v.surface;
  const MaterialValues& m = v.material;
  const vec3 wo = -path.ray.direction;
  const bool front = dot(wo, s.ng) >= 0;
  const vec3 ng = front ? s.ng : -s.ng;
  vec3 n = front ? s.ns : -s.ns;
  if (m.specular > 0 || m.metallic > 0) n = bend_normal(ng, wo, n);
  all.wo.set(i, wo);
  all.ng.set(i, ng);
  all.n.set(i, n);
  all.base_color.set(i, m.base_color);
  all.coat_f0.set(i, dielectric_f0(m, v.boundary.outside));
  all.specular.of[i] = m.specular;
  all.metallic.of[i] = m.metallic;
  all.roughness.of[i] = m.roughness;
  all.p.set(i, s.p);
  all.offset.of[i] = s.offset;
  all.throughput.set(i, path.throughput);
  all.radiance_scale.of[i] = path.radiance_scale;
  const vec2 to_light = c.sampler.get2(vertex_pair(path, kLightPair));
  const vec2 to_scatter = c.sampler.get2(vertex_pair(path, kScatterPair));
  const vec2 chance = c.sampler.get2(vertex_pair(path, kChancePair));
  all.light_u.of[i] = to_light.x;
  all.light_v.of[i] = to_light.y;
  all.scatter_u.of[i] = to_scatter.x;
  all.scatter_v.of[i] = to_scatter.y;
  all.lobe_u.of[i] = chance.x;
  all.chance_u.of[i] = chance.y;
  all.ends_by_chance.of[i] = path.edges + 1 > c.settings.roulette_depth ? 1 : 0;
  const bool looks = c.scene.caster_count > 0 && path.edges <= kCasterEdges;
  all.looks.of[i] = looks ? 1 : 0;
  all.any_looks |= looks;
  if (light) return;
  const Receiver receiver = receiver_at(c.scene, s.p, n, Facing::kFront, c.time);
  LightSample& sample = all.light[i];
  const bool found = has_lights(c.scene) && sample_light(c.scene, receiver, to_light, sample);
  all.surface_share.of[i] = receiver.surface_share;
  all.light_pdf.of[i] = found ? sample.pdf : 0;
  if (!found) return;
  all.light_direction.set(i, sample.direction);
  all.light_target.set(i, sample.target);
  all.light_near.of[i] = sample.light == kNone ? 0 : 1;
  all.diffuse_sees.of[i] = sample.visibility & kDiffuseRay ? 1 : 0;
  all.glossy_sees.of[i] = sample.visibility & kGlossyRay ? 1 : 0;
  all.weighed.of[i] = shows_to_all(sample.visibility) ? 1 : 0;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
