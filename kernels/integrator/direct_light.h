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

// A type of point that scatters light provides:
//   receiver       the point as a light tree sees it
//   scattered      how much of the light from a direction it sends on along the path
//   leave_towards  where a ray in that direction starts
//   cross_towards  what it starts inside of
//   color_towards  colour of the path's wavelength, where light in that direction is split
//   first_vertex   what the point does with the light where it is the path's first

/// Colour that light takes on where it crosses the surface: that of the path's wavelength, where
/// glass splits it first.
template <Tracer T>
KERNEL vec3 color_of_crossing(const PathContext<T>& c, const Path& path, const Vertex& v) {
  if (path.dispersed || !disperses(*v.surface.material, v.material)) return vec3(1);
  return spectral_at(c.sampler.get1(kWavelengthPair)).color;
}
/// Normals of the sides that receive light. A clearcoat may have a normal of its own, but no light
/// from below the surface.
template <class F, Features S>
KERNEL Vec3<F> receiving_normal(const BsdfOf<F, S>& b) {
  return select(is_layered(b), b.ng, b.frame.n);
}
/// True where light from below the surface can pass it.
template <class F, Features S>
KERNEL BoolOf<F> receives_below(const BsdfOf<F, S>& b) {
  const BoolOf<F> glass = is_glass(b), translucent = is_translucent(b);
  return glass | translucent;
}
/// Sets Vertex::receiver, but for its surface_share.
KERNEL void set_receiver(Vertex& v, float time) {
  const Bsdf& b = v.bsdf;
  Receiver& receiver = v.receiver;
  receiver.p = v.surface.p;
  receiver.n = receiving_normal(b);
  receiver.facing = receives_below(b) ? Facing::kBoth : Facing::kFront;
  receiver.time = time;
}
/// Density [1/sr] with which choose_direction() takes a direction whose density among the surface's
/// own is `pdf`. Casters are looked for on the near side only.
template <class F, Features S>
KERNEL F scatter_pdf(const BsdfOf<F, S>& b, const CasterConesOf<F>& casters, Vec3<F> wi, F pdf) {
  if (casters.count == 0) return pdf;
  const F own = (1 - casters.probability) * pdf;
  const BoolOf<F> above = (pdf > 0) & (dot(b.ng, wi) > 0);
  if (!any(above)) return own;
  return select(above, own + casters.probability * casters_pdf(casters, wi), own);
}
/// visibility: of the light.
template <class F, Features S>
KERNEL BsdfValueOf<F> scattered(const BsdfOf<F, S>& b, const CasterConesOf<F>& casters, Vec3<F> wi,
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
KERNEL vec3 leave_towards(const Vertex& v, vec3 wi) { return offset_point(v.surface, wi); }
KERNEL void cross_towards(const Vertex& v, vec3 wi, Inside& inside) {
  if (kRich && dot(v.bsdf.ng, wi) < 0) cross_surface(inside, v.surface, v.material, wi);
}
template <Tracer T>
KERNEL vec3 color_towards(const PathContext<T>& c, const Path& path, const Vertex& v, vec3 wi) {
  return dot(v.bsdf.ng, wi) < 0 ? color_of_crossing(c, path, v) : vec3(1);
}
template <Tracer T, class Point>
KERNEL vec3 color_towards(const PathContext<T>&, const Path&, const Point&, vec3) {
  return vec3(1);
}
KERNEL FirstVertex first_vertex(const Vertex& v, vec3 wi) {
  return dot(v.bsdf.ng, wi) < 0 ? FirstVertex::kTransmits : FirstVertex::kReflects;
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

/// Light that comes along its ray if nothing is in the way: drivers trace many such rays at a time.
/// t_max 0: there is none.
struct LaterLight {
  Ray ray;
  Contribution light;
  Route route;
};

/// Sends light along a ray: media and volumes weaken it, and what it may pass tints it. What only
/// surfaces can hold up waits for its ray to be traced; the rest counts at once.
///
/// inside   what the ray starts inside of
template <Tracer T>
HELIO_ALWAYS_INLINE KERNEL void send(const PathContext<T>& c, const Path& path, Inside& inside,
                                     LaterLight& sent, SampleValues& sample) {
  const Ray& ray = sent.ray;
  vec3& radiance = sent.light.radiance;
  const bool passes =
      kRich && (c.scene.any_passable || (c.scene.any_priority && is_filled(inside)));
  if (passes) {
    radiance *= passing_surfaces(c, ray, inside, sample);
  } else {
    ++sample.rays;
    if (is_filled(inside)) radiance *= transmittance(inside, ray.t_max);
  }
  if (kRich && c.scene.volume_count > 0 && !is_black(radiance)) {
    radiance *= transmittance(c.scene, ray, c.sampler.hash_of(kShadowCollisionHash + path.edges));
  }
  if (passes && !is_black(radiance)) collect(c, sample, sent.light, sent.route);
  if (passes || is_black(radiance)) sent.ray.t_max = 0;
}

/// Traces the ray of light that waits.
template <Tracer T>
KERNEL void shine(const PathContext<T>& c, const LaterLight& light, SampleValues& sample) {
  if (light.ray.t_max > 0 && !c.tracer.occluded(light.ray, kShadowRay))
    collect(c, sample, light.light, light.route);
}

/// Light of directions that sample_light() has chosen, as points send it on if it comes.
template <class F>
struct TakenLightOf {
  BoolOf<F> counts;
  ShadowRayOf<F> ray;      // that decides whether it comes
  Vec3<F> total, diffuse;  // what of its radiance goes on, and what of that is diffuse
  F weight;                // of the strategy, over its density
};
/// f        what of the light is scattered
/// origin   of the ray
template <class F>
KERNEL TakenLightOf<F> take_light(const LightDirectionOf<F>& light, const BsdfValueOf<F>& f,
                                  Vec3<F> origin) {
  TakenLightOf<F> taken;
  taken.total = f.diffuse + f.glossy;
  taken.diffuse = f.diffuse;
  taken.counts = max_component(taken.total) > 0;
  if (!any(taken.counts)) return taken;
  taken.ray = shadow_ray(origin, light);
  taken.counts = taken.counts & taken.ray.is_there;
  taken.weight =
      select(shows_to_all(light.visibility), mis_weight(light.pdf, f.pdf), F(1)) / light.pdf;
  return taken;
}

/// Radiance that reaches the camera if nothing is in the light's way.
///
/// carried   by the path, times the colour that the light takes on where it crosses the surface
template <class F>
KERNEL Vec3<F> contribution(const TakenLightOf<F>& taken, Vec3<F> carried, Vec3<F> radiance) {
  return carried * taken.total * radiance * taken.weight;
}

/// Aims light that a point has taken.
///
/// radiance   its contribution()
KERNEL void aim(const TakenLightOf<float>& taken, vec3 radiance, float time, LaterLight& sent) {
  sent.ray.origin = taken.ray.origin;
  sent.ray.direction = taken.ray.direction;
  sent.ray.t_max = taken.ray.end;
  sent.ray.time = time;
  sent.light.radiance = radiance;
}
/// Sends light that has been aimed along its ray.
///
/// taken()   what the point has taken; asked where it decides the planes that the light belongs to
template <Tracer T, class Point, class F>
KERNEL void send_taken(const PathContext<T>& c, const Path& path, const Point& at,
                       const LightSample& light, const F& taken, SampleValues& sample,
                       LaterLight& sent) {
  Inside inside;
  if (has_media(c.scene)) {
    inside = path.inside;
    cross_towards(at, light.direction, inside);
  }
  sent.ray.holes = hole_key(c, kShadowHoleHash + path.edges);
  sent.light.edges = path.edges + 1;
  sent.light.environment = light.light == kNone;
  sent.light.group =
      wants_rich(c.film, plane_bit(Plane::BEAUTY_GROUP)) ? light_group(c.scene, light) : 0;
  if (path.edges == 1 && wants_rich(c.film, kLightPlaneSet)) {
    const TakenLightOf<float> what = taken();
    sent.route = {share_of(what.diffuse, what.total), first_vertex(at, light.direction)};
  } else {
    sent.route = path.route;
  }
  send(c, path, inside, sent, sample);
}

/// Light that comes to a point straight from one light.
template <Tracer T, class Point>
KERNEL void sample_light(const PathContext<T>& c, const Path& path, const Point& at,
                         SampleValues& sample, LaterLight& sent) {
  LightSample light;
  const vec2 u = c.sampler.get2(vertex_pair(path, kLightPair));
  if (!sample_light(c.scene, at.receiver, u, light)) return;
  const BsdfValue f = scattered(at, light.direction, light.visibility);
  const TakenLightOf<float> taken =
      take_light(direction_of(light), f, leave_towards(at, light.direction));
  if (!taken.counts) return;
  const vec3 carried = path.throughput * color_towards(c, path, at, light.direction);
  aim(taken, contribution(taken, carried, light_radiance(c.scene, light)), c.time, sent);
  send_taken(c, path, at, light, [&] { return taken; }, sample, sent);
}
/// The same at once.
template <Tracer T, class Point>
KERNEL void sample_light(const PathContext<T>& c, const Path& path, const Point& at,
                         SampleValues& sample) {
  LaterLight sent;
  sent.ray.t_max = 0;
  sample_light(c, path, at, sample, sent);
  shine(c, sent, sample);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
