// What becomes of plain vertices: the light that they are sampled, and where paths go on from them.
// It is that of direct_light.h and path.h, in lanes. Called by lockstep.h.
//
// Tested: tests/unit/lockstep_test.cpp, against render_pixel().
#pragma once

#include "kernels/schedule/plain_casters.h"
#include "kernels/schedule/plain_lights.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// set_base() of plain materials.
KERNEL OpaqueBase<Floats> plain_base(const PlainVertices& v) {
  OpaqueBase<Floats> b;
  const Floats roughness = v.roughness, alpha = sqr(roughness);
  b.ng = v.ng;
  b.frame = make_frame(Vec3<Floats>(v.n));
  b.wo = to_local(b.frame, Vec3<Floats>(v.wo));
  b.wo.z = max2(b.wo.z, Floats(1e-4f));
  b.facets = {alpha, alpha};
  b.albedo = albedo_row(roughness);
  const OpaqueMaterial<Floats> m{v.base_color, v.coat_f0, v.specular, v.metallic,
                                 1 - Floats(v.metallic)};
  const AlbedoOf<Floats> average = albedo_average(b.albedo), out = albedo_at(b.albedo, b.wo.z);
  set_multiple(b, m, set_fresnel(b, m), average);
  const Floats lost = max2(1 - out.total, Floats(0));
  const Floats facets = facets_reflect(b, out);
  const Vec3<Floats> under = m.base_color * ((1 - coat_albedo(b, out)) * m.plastic);
  const Floats diffuse = set_diffuse(b, under, lost, average);
  b.diffuse_probability = select(diffuse > 0, diffuse / (diffuse + facets), Floats(0));
  b.facet_probability = 1 - b.diffuse_probability;
  return b;
}

/// evaluate_bsdf() of plain materials.
KERNEL BsdfValueOf<Floats> evaluate(const OpaqueBase<Floats>& b, Vec3<Floats> wi_world) {
  const Vec3<Floats> wi = to_local(b.frame, wi_world);
  BsdfValueOf<Floats> out;
  add_coated(b, wi, albedo_at(b.albedo, wi.z), out);
  const Mask cosine = b.diffuse_probability > 0;
  const Vec3<Floats> none(0);
  out.diffuse = select(cosine, out.diffuse, none);
  out.glossy = select(cosine, out.glossy, none);
  out.pdf = b.diffuse_probability * wi.z * kInvPi;
  const Vec3<Floats> h = normalize(b.wo + wi);
  BsdfValueOf<Floats> both = out;
  add_facets(b, wi, h, opaque_facet(b, dot(b.wo, h)), b.facet_probability, both);
  const Mask facets = b.facet_probability > 0;
  const Mask above = (wi.z > 0) & (dot(b.ng, wi_world) > 0);
  out.diffuse = select(above, out.diffuse, none);
  out.glossy = select(above, select(facets, both.glossy, out.glossy), none);
  out.pdf = select(above, select(facets, both.pdf, out.pdf), Floats(0));
  return out;
}

/// offset_point()
KERNEL Vec3<Floats> origin_towards(const PlainVertices& v, Vec3<Floats> direction) {
  const Vec3<Floats> ng = v.ng;
  const Floats offset = v.offset;
  return Vec3<Floats>(v.p) + ng * select(dot(ng, direction) < 0, -offset, offset);
}

/// shadow_ray(); which lanes have one.
KERNEL Mask set_rays_of_light(PlainVertices& v) {
  const Vec3<Floats> direction = v.light_direction;
  const Vec3<Floats> origin = origin_towards(v, direction);
  const Vec3<Floats> d = Vec3<Floats>(v.light_target) - origin;
  const Floats distance = sqrt(dot(d, d));
  const Mask near = Floats(v.light_near) > 0;
  v.ray_origin = origin;
  v.ray_direction = select(near, d / distance, direction);
  v.ray_end = select(near, distance * kJustBefore, Floats(INFINITY));
  return (!near) | (distance > 0);
}

/// sample_light() at each, but for its ray and what it brings.
HELIO_ALWAYS_INLINE KERNEL void take_lights(const SceneView& scene, bool plain_lights,
                                            const OpaqueBase<Floats>& b, PlainVertices& v) {
  if (plain_lights) sample_lights(scene, b, v);
  const Floats light_pdf = v.light_pdf;
  BsdfValueOf<Floats> f = evaluate(b, v.light_direction);
  if (v.any_looks) f.pdf = scatter_pdf(v, v.light_direction, f.pdf);
  f.diffuse *= Floats(v.diffuse_sees);
  f.glossy *= Floats(v.glossy_sees);
  const Vec3<Floats> total = f.diffuse + f.glossy;
  const Floats weight = select(Floats(v.weighed) > 0, mis_weight(light_pdf, f.pdf), Floats(1));
  v.light_seen = Vec3<Floats>(v.throughput) * total;
  v.light_weight = weight / light_pdf;
  v.light_total = total;
  v.light_diffuse = f.diffuse;
  v.lit = bits_of(first_lanes(v.count) & (light_pdf > 0) & (max_component(total) > 0) &
                  set_rays_of_light(v));
}

/// A direction in which each goes on, of the surface's choice.
struct Scattered {
  Mask valid;
  Mask facets;  // by microfacets
  Vec3<Floats> direction;
  BsdfValueOf<Floats> f;
};
/// sample_bsdf()
HELIO_ALWAYS_INLINE KERNEL Scattered sample_own(const OpaqueBase<Floats>& b,
                                                const PlainVertices& v) {
  const Mask all = first_lanes(v.count);
  const Vec2<Floats> u(v.scatter_u, v.scatter_v);
  const Mask facets = Floats(v.lobe_u) >= b.diffuse_probability;
  Vec3<Floats> wi(0, 0, 1);
  Mask valid = all;
  if (any(all & !facets)) wi = sample_cosine(u);
  if (any(all & facets)) {
    const Vec3<Floats> h = sample_ggx(b.wo, b.facets, u);
    const Floats wo_h = dot(b.wo, h);
    const Vec3<Floats> mirrored = h * (2 * wo_h) - b.wo;
    valid = valid & ((!facets) | ((wo_h > 0) & (mirrored.z > 0)));
    wi = select(facets, mirrored, wi);
  }
  const Vec3<Floats> direction = to_world(b.frame, wi);
  const BsdfValueOf<Floats> f = evaluate(b, direction);
  return {valid & (f.pdf > 0), facets, direction, f};
}

/// Turns samples of the surface's own into those towards casters, where lanes aim at one.
HELIO_RARE KERNEL void turn_to_casters(const OpaqueBase<Floats>& b, const Aimed& aimed,
                                       Scattered& s) {
  const auto& [wi, rest] = aimed.to;
  const Mask lanes = aimed.lanes;
  const BsdfValueOf<Floats> f = evaluate(b, wi);
  const Mask facets = rest * f.pdf >= b.diffuse_probability * dot(b.frame.n, wi) * kInvPi;
  s.valid = (lanes & (f.pdf > 0)) | (s.valid & !lanes);
  s.facets = (lanes & facets) | (s.facets & !lanes);
  s.direction = select(lanes, wi, s.direction);
  s.f.diffuse = select(lanes, f.diffuse, s.f.diffuse);
  s.f.glossy = select(lanes, f.glossy, s.f.glossy);
  s.f.pdf = select(lanes, f.pdf, s.f.pdf);
}

/// scatter() at each.
HELIO_ALWAYS_INLINE KERNEL void scatter_on(const OpaqueBase<Floats>& b, PlainVertices& v) {
  Aimed aimed{};
  if (v.any_looks) aimed = aim(v);
  Scattered s = sample_own(b, v);
  Floats scale = 1 / s.f.pdf;
  Vec3<Floats> sent = (s.f.diffuse + s.f.glossy) * scale;
  v.own_weight = select(s.valid, sent, Vec3<Floats>(0));
  v.diffuse_weight = s.f.diffuse * scale;
  v.pdf = s.f.pdf;
  if (v.any_looks) {
    if (any(aimed.lanes)) turn_to_casters(b, aimed, s);
    const Floats pdf = scatter_pdf(v, s.direction, s.f.pdf), mixed = s.f.pdf / pdf;
    scale = 1 / s.f.pdf;
    sent = (s.f.diffuse + s.f.glossy) * scale * mixed;
    v.diffuse_weight = s.f.diffuse * scale * mixed;
    v.pdf = pdf;
  }
  v.weight = sent;
  v.origin = origin_towards(v, s.direction);
  v.direction = s.direction;
  v.glossy = bits_of(s.facets);

  const Vec3<Floats> carried = Vec3<Floats>(v.throughput) * sent;
  const Floats chance =
      select(Floats(v.ends_by_chance) > 0,
             survival_chance(max_component(carried) * Floats(v.radiance_scale)), Floats(1));
  v.survive = bits_of(s.valid & (Floats(v.chance_u) < chance));
  v.throughput = carried * (1 / chance);
}

KERNEL void scatter_all(const SceneView& scene, bool plain_lights, PlainVertices& v) {
  const OpaqueBase<Floats> b = plain_base(v);
  if (v.any_looks) gather_caustic_targets(scene, b, v);
  take_lights(scene, plain_lights, b, v);
  scatter_on(b, v);
}

/// What lights send to a lane that is lit.
KERNEL vec3 radiance_of(const SceneView& scene, bool plain_lights, const LightSample& light) {
  if (!plain_lights) return light_radiance(scene, light);
  return light.light == kNone ? scene.dome.radiance : scene.lights[light.light].radiance;
}
KERNEL u32 group_of(const SceneView& scene, bool plain_lights, const LightSample& light) {
  if (plain_lights && light.light == kNone) return scene.dome.light_group;
  return light_group(scene, light);
}

/// The light of a lane that is lit; its ray decides whether it comes.
template <Tracer T>
KERNEL void take_light(const PlainVertices& v, u32 i, bool plain_lights, const PathContext<T>& c,
                       const Path& path, SampleValues& sample, LaterLight& later) {
  const Ray ray{v.ray_origin.get(i), v.ray_direction.get(i), v.ray_end.of[i], c.time,
                hole_key(c, kShadowHoleHash + path.edges)};
  const LightSample& light = v.light[i];
  const Contribution sent{
      v.light_seen.get(i) * radiance_of(c.scene, plain_lights, light) * v.light_weight.of[i],
      path.edges + 1, light.light == kNone, group_of(c.scene, plain_lights, light)};
  Route route = path.route;
  if (path.edges == 1 && wants_rich(c.film, kLightPlaneSet)) {
    route = {share_of(v.light_diffuse.get(i), v.light_total.get(i)), FirstVertex::kReflects};
  }
  Inside inside;
  if (has_media(c.scene)) inside = path.inside;
  send_later(c, path, ray, inside, sent, route, sample, later);
}

/// The path of a lane goes on; false when it ends.
template <Tracer T>
KERNEL bool go_on(const PlainVertices& v, u32 i, const PathContext<T>& c, Path& path,
                  SampleValues& sample) {
  if (!path.guided) record_guides(path, v.own_weight.get(i), v.n.get(i), sample);
  if (!(v.survive >> i & 1)) return false;
  if (path.edges == 1 && wants_rich(c.film, kLightPlaneSet)) {
    path.route = {share_of(v.diffuse_weight.get(i), v.weight.get(i)), FirstVertex::kReflects};
  }
  path.throughput = v.throughput.get(i);
  const Receiver from{v.p.get(i), v.n.get(i), Facing::kFront, c.time, v.surface_share.of[i]};
  const u32 mask = v.glossy >> i & 1 ? kGlossyRay : kDiffuseRay;
  go_on(c, path, {v.origin.get(i), v.direction.get(i), v.pdf.of[i], mask, from});
  return path.edges <= c.settings.max_depth;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
