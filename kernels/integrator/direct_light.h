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
/// Density [1/sr] with which scatter() takes a direction whose density among the surface's own is
/// `pdf`. Casters are looked for on the near side only.
KERNEL float scatter_pdf(const Vertex& v, vec3 wi, float pdf) {
  if (v.casters->count == 0) return pdf;
  const float own = (1 - v.casters->probability) * pdf;
  if (!(pdf > 0) || dot(v.bsdf.ng, wi) <= 0) return own;
  return own + v.casters->probability * casters_pdf(*v.casters, wi);
}
/// visibility: of the light.
KERNEL BsdfValue scattered(const Vertex& v, vec3 wi, u32 visibility) {
  BsdfValue f = evaluate_bsdf(v.bsdf, wi);
  f.pdf = scatter_pdf(v, wi, f.pdf);
  const bool transmitted = dot(v.bsdf.ng, wi) < 0;
  if (!(visibility & kDiffuseRay)) f.diffuse = vec3(0);
  if (!(visibility & (transmitted ? kTransmissionRay : kGlossyRay))) f.glossy = vec3(0);
  return f;
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

/// Light that comes to a point straight from one light.
template <Tracer T, class Point>
KERNEL void sample_light(const PathContext<T>& c, const Path& path, const Point& at,
                         SampleValues& sample) {
  LightSample light;
  const vec2 u = c.sampler.get2(vertex_pair(path, kLightPair));
  if (!sample_light(c.scene, at.receiver, u, light)) return;
  const BsdfValue f = scattered(at, light.direction, light.visibility);
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

}  // namespace heliograph::kernels::inline HELIO_ISA
