// Light that comes to a point straight from one light (next event estimation). Called by path.h and
// medium_path.h.
#pragma once

#include "kernels/bsdf/bsdf.h"
#include "kernels/integrator/path_state.h"
#include "kernels/light/caster.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// The surface at the end of the path's ray.
struct Vertex {
  Surface surface;
  Boundary boundary;
  MaterialValues material;
  vec3 emission;  // towards the path, with what an unlit material shows
  Bsdf bsdf;
  Receiver receiver;
  CasterCones* casters;
};

// What scatters light, at any point, is to say:
//   receiver       the point as a light tree sees it
//   scattered      how much of the light from a direction it sends on along the path
//   leave_towards  where a ray in that direction starts, and what it starts inside of
//   route_of       the planes that its light belongs to where it is the path's first

/// A clearcoat may have a normal of its own, but no light from below the surface.
KERNEL Receiver receiver_of(const SceneView& scene, const Vertex& v, float time) {
  const Bsdf& b = v.bsdf;
  return receiver_at(scene, v.surface.p, is_layered(b) ? b.ng : b.frame.n,
                     b.glass > 0 ? Facing::kBoth : Facing::kFront, time);
}
/// Density [1/sr] with which choose_direction() takes a direction whose density among the surface's
/// own is `pdf`. Casters are looked for on the near side only.
template <class F>
KERNEL F scatter_pdf(const BsdfOf<F>& b, const CasterConesOf<F>& casters, Vec3<F> wi, F pdf) {
  if (casters.count == 0) return pdf;
  const F own = (1 - casters.probability) * pdf;
  const BoolOf<F> above = (pdf > 0) & (dot(b.ng, wi) > 0);
  if (!any(above)) return own;
  return select(above, own + casters.probability * casters_pdf(casters, wi), own);
}
/// visibility: of the light.
template <class F>
KERNEL BsdfValueOf<F> scattered(const BsdfOf<F>& b, const CasterConesOf<F>& casters, Vec3<F> wi,
                                IntOf<F> visibility) {
  const auto sees = [visibility](u32 ray) { return !((visibility & i32(ray)) == 0); };
  BsdfValueOf<F> f = evaluate_bsdf(b, wi);
  f.pdf = scatter_pdf(b, casters, wi, f.pdf);
  const BoolOf<F> transmitted = dot(b.ng, wi) < 0;
  f.diffuse = select(sees(kDiffuseRay), f.diffuse, Vec3<F>(0));
  f.glossy =
      select(select(transmitted, sees(kTransmissionRay), sees(kGlossyRay)), f.glossy, Vec3<F>(0));
  return f;
}
KERNEL BsdfValue scattered(const Vertex& v, vec3 wi, u32 visibility) {
  return scattered(v.bsdf, *v.casters, wi, i32(visibility));
}
KERNEL vec3 leave_towards(const Vertex& v, vec3 wi, Inside& inside) {
  if (kRich && dot(v.bsdf.ng, wi) < 0) cross_surface(inside, v.surface, v.material, wi);
  return offset_point(v.surface, wi);
}
KERNEL Route route_of(const Vertex& v, vec3 wi, const BsdfValue& f) {
  return {share_of(f.diffuse, f.diffuse + f.glossy),
          dot(v.bsdf.ng, wi) < 0 ? FirstVertex::kTransmits : FirstVertex::kReflects};
}

/// unshadowed() where light may pass surfaces: those that are there tint it.
template <Tracer T>
HELIO_RARE KERNEL vec3 passing_surfaces(const PathContext<T>& c, Ray ray, Inside& inside,
                                        SampleValues& sample) {
  vec3 share(1);
  for (u32 i = 0; i <= kMostPassed; ++i) {
    const Hit hit = c.tracer.closest(ray, kShadowRay);
    ++sample.rays;
    if (hit.instance == kNone) return share * transmittance(inside, ray.t_max);
    const Surface s = locate(c.scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), c.time);
    const Boundary boundary = boundary_at(c.scene, inside, s, ray.direction);
    if (boundary.meeting == Meeting::kScatters) return vec3(0);
    const MaterialValues m = material_at(c.scene, s, ~kAlphaBit);
    share *= transmittance(inside, hit.t);
    if (boundary.meeting == Meeting::kPasses) share *= tint_of_crossing(m);
    if (!(max_component(share) > 0)) return vec3(0);
    cross_surface(inside, s, m, ray.direction);
    const vec3 origin = offset_point(s, ray.direction);
    ray.t_max -= dot(origin - ray.origin, ray.direction);
    ray.origin = origin;
  }
  return vec3(0);
}

/// Share of the light at the end of a shadow ray that comes to its origin. Media on its way weaken
/// it, surfaces hold it up.
template <Tracer T>
KERNEL vec3 unshadowed(const PathContext<T>& c, const Ray& ray, Inside& inside,
                       SampleValues& sample) {
  if (kRich && (c.scene.any_passable || (c.scene.any_priority && is_filled(inside))))
    return passing_surfaces(c, ray, inside, sample);
  ++sample.rays;
  if (c.tracer.occluded(ray, kShadowRay)) return vec3(0);
  return transmittance(inside, ray.t_max);
}

/// Collects what of a light comes along a ray: surfaces hold it up, media and volumes weaken it.
///
/// inside   what the ray starts inside of
template <Tracer T>
KERNEL void send(const PathContext<T>& c, const Path& path, const Ray& ray, Inside& inside,
                 Contribution light, const Route& route, SampleValues& sample) {
  light.radiance *= unshadowed(c, ray, inside, sample);
  if (is_black(light.radiance)) return;
  if (kRich && c.scene.volume_count > 0) {
    light.radiance *=
        transmittance(c.scene, ray, c.sampler.hash_of(kShadowCollisionHash + path.edges));
  }
  collect(c, sample, light, route);
}

/// Light that sample_light() has chosen comes to a point, which sends `f` of it on.
template <Tracer T, class Point>
KERNEL void take_light(const PathContext<T>& c, const Path& path, const Point& at,
                       const LightSample& light, const BsdfValue& f, SampleValues& sample) {
  const vec3 total = f.diffuse + f.glossy;
  if (!(max_component(total) > 0)) return;

  Inside inside;
  if (has_media(c.scene)) inside = path.inside;
  const vec3 origin = leave_towards(at, light.direction, inside);
  Ray ray{origin, light.direction, INFINITY, c.time, hole_key(c, kShadowHoleHash + path.edges)};
  if (!shadow_ray(origin, light, ray)) return;
  const float weight = shows_to_all(light.visibility) ? mis_weight(light.pdf, f.pdf) : 1;
  const vec3 radiance =
      path.throughput * total * light_radiance(c.scene, light) * (weight / light.pdf);
  const bool routed = path.edges == 1 && wants_rich(c.film, kLightPlaneSet);
  const Route route = routed ? route_of(at, light.direction, f) : path.route;
  const u32 group = light_group(c.scene, light);
  send(c, path, ray, inside, {radiance, path.edges + 1, light.light == kNone, group}, route,
       sample);
}

/// Light that comes to a point straight from one light.
template <Tracer T, class Point>
KERNEL void sample_light(const PathContext<T>& c, const Path& path, const Point& at,
                         SampleValues& sample) {
  LightSample light;
  const vec2 u = c.sampler.get2(vertex_pair(path, kLightPair));
  if (!sample_light(c.scene, at.receiver, u, light)) return;
  take_light(c, path, at, light, scattered(at, light.direction, light.visibility), sample);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
