// The integrator: unbiased path tracing with next event estimation and multiple importance
// sampling, as steps of a path. Drivers take them: scalar.h one path after the other, lockstep.h
// many side by side on a CPU, wave.h on a GPU.
#pragma once

#include <new>

#include "kernels/integrator/catcher.h"
#include "kernels/integrator/first_ray.h"
#include "kernels/integrator/miss.h"
#include "kernels/integrator/path_volume.h"
#include "kernels/integrator/subsurface.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Gives what a path starts inside of the index of the path's wavelength.
template <Tracer T>
KERNEL void disperse(const PathContext<T>& c, Inside::Layer& layer) {
  const float dispersion = layer.material->constant.dispersion;
  if (dispersion > 0)
    layer.ior = dispersed_ior(layer.ior, dispersion, c.sampler.get1(kWavelengthPair));
}

/// A path that sets out with a camera's ray.
template <Tracer T>
KERNEL Path path_along(const PathContext<T>& c, const Ray& ray, SampleValues& sample) {
  Path path;
  path.ray = ray;
  path.mask = kCameraRay;
  path.throughput = vec3(1);
  path.pdf = 0;
  path.radiance_scale = 1;
  path.edges = 1;
  path.guided = (c.film.wanted & kGuidePlaneSet) == 0;
  path.blurred = false;
  path.dispersed = false;
  path.cone = pixel_cone(c.camera);
  path.route = {vec3(0), FirstVertex::kReflects};
  path.passed = 0;
  path.boundaries = 0;
  if (has_media(c.scene)) {
    path.inside = inside_at(c.scene, c.tracer, path.ray, sample.rays);
    for (u32 i = 0; i < path.inside.depth; ++i) disperse(c, path.inside.layers[i]);
  }
  return path;
}

/// Weight of light that the path met by itself where sample_light could have found it too.
KERNEL float emission_weight(const SceneView& scene, const Path& path, const Hit& hit, u32 light) {
  if (path.pdf <= 0 || light == kNone) return 1;
  if (!shows_to_all(scene.instances[hit.instance].visibility)) return 0;
  Hit from_vertex = hit;
  from_vertex.t += path.passed;
  return mis_weight(path.pdf,
                    light_pdf(scene, receiver_of(path), from_vertex, path.ray.direction, light));
}

/// The path meets a surface: finds out what its material is and counts what it emits.
///
/// v   its surface is set
template <Tracer T>
HELIO_ALWAYS_INLINE KERNEL void hit_surface(const PathContext<T>& c, Path& path, const Hit& hit,
                                            Vertex& v, SampleValues& sample) {
  const Surface& s = v.surface;
  path.cone.width += path.cone.spread * hit.t;
  new (&v.material) MaterialValues(material_at(c.scene, s, ~kAlphaBit, path.cone.width));
  if (path.blurred && c.settings.regularize) regularize(v.material);
  if (kRich && disperses(*s.material, v.material))
    v.material.ior = dispersed_ior(v.material, c.sampler.get1(kWavelengthPair));
  v.boundary = boundary_at(c.scene, path.inside, s, path.ray.direction);
  if (v.boundary.meeting == Meeting::kAbsent) return;
  const bool shines = s.light != kNone || !is_black(v.material.emission);
  const vec3 emission = shines ? emitted(c.scene, s, v.material, -path.ray.direction) : vec3(0);
  const vec3 own = shown(s, v.material);
  v.emission = emission + own;
  if (is_black(v.emission)) return;
  const vec3 light = emission * emission_weight(c.scene, path, hit, s.light) + own;
  const u32 group = s.instance->light_group;
  collect(c, sample, {path.throughput * light, path.edges, false, group}, path.route);
}

/// How surfaces scatter light, and the casters that they see. Returns which scatter any.
///
/// looks   where paths look for casters
template <class F, Features S>
KERNEL BoolOf<F> set_scattering(const SceneView& scene, const MaterialValuesOf<F>& m,
                                const ShadingPointOf<F>& at, Vec3<F> p, BoolOf<F> looks,
                                BsdfOf<F, S>& b, CasterConesOf<F>& casters) {
  set_bsdf(b, m, at);
  const BoolOf<F> any_light = scatters(b);
  casters.count = 0;
  casters.probability = F(0);
  looks = looks & any_light & (above_probability(b) > 0);
  if (any(looks)) {
    gather_caustic_targets(casters, scene, p, b.frame.n);
    casters.probability = select(looks, casters.probability, F(0));
  }
  return any_light;
}
KERNEL bool looks_for_casters(const SceneView& scene, const Path& path) {
  return path.edges <= kCasterEdges && scene.caster_count > 0;
}

/// Where paths go on from surfaces.
template <class F>
struct DirectionOf {
  BsdfSampleOf<F> sample;
  BoolOf<F> goes_on;
  BoolOf<F> is_vertex;  // it is no perfect mirror to the path: denoising guides are recorded
  Vec3<F> guide;        // the weight of light that goes on by the surface's own choice
  CarriedOf<F> carried;
  F spread;  // lobe_spread() of the sample's density
};

/// Turns samples of surfaces' own into those of directions towards casters, too. Returns which go
/// on.
///
/// aimed, choice   whether one is to go to a caster, and uniform in [0, 1) which
template <class F, Features S>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL BoolOf<F> mix_casters(const BsdfOf<F, S>& b,
                                                             const CasterConesOf<F>& casters,
                                                             BoolOf<F> aimed, F choice, Vec2<F> u,
                                                             BoolOf<F> goes_on,
                                                             BsdfSampleOf<F>& s) {
  if (any(aimed)) {
    const CasterDirectionOf<F> to = sample_casters(casters, choice, u);
    const BsdfValueOf<F> f = evaluate_bsdf(b, to.wi);
    const F diffuse = above_probability(b) * dot(b.frame.n, to.wi) * kInvPi;
    const F scale = 1 / f.pdf;
    const BsdfSampleOf<F> towards{to.wi,
                                  (f.diffuse + f.glossy) * scale,
                                  f.diffuse * scale,
                                  f.pdf,
                                  F(1),
                                  select(to.rest * f.pdf < diffuse, EnumOf<F, Lobe>(Lobe::kDiffuse),
                                         EnumOf<F, Lobe>(Lobe::kGlossy))};
    s = select(aimed, towards, s);
    const BoolOf<F> lit = (f.pdf > 0) & (dot(b.ng, to.wi) > 0);
    goes_on = select(aimed, lit, goes_on);
    if (!any(goes_on)) return goes_on;
  }
  const BoolOf<F> smooth = s.pdf > 0;
  const F pdf = scatter_pdf(b, casters, s.wi, s.pdf);
  const F factor = select(smooth, s.pdf / pdf, 1 / (1 - casters.probability));
  s.weight *= factor;
  s.diffuse *= select(smooth, factor, F(1));
  s.pdf = select(smooth, pdf, s.pdf);
  return goes_on;
}

/// Chooses where paths go on, if they do: by the surface, or towards a caster.
///
/// carried      by the paths that come
/// begun        where roulette has
/// choice, u    uniform in [0, 1)
/// survival()   the same
template <class F, Features S, class U>
KERNEL DirectionOf<F> choose_direction(const BsdfOf<F, S>& b, const CasterConesOf<F>& casters,
                                       Vec3<F> subsurface_color, const CarriedOf<F>& carried,
                                       BoolOf<F> begun, F choice, Vec2<F> u, const U& survival) {
  DirectionOf<F> to;
  BsdfSampleOf<F>& s = to.sample;
  const F share = casters.probability;
  const BoolOf<F> aimed = choice < share;
  if (casters.count > 0) {
    choice = select(aimed, rescale_uniform(choice, share),
                    rescale_uniform(F(choice - share), F(1 - share)));
  }
  to.goes_on = sample_bsdf(b, choice, u, s);
  const BoolOf<F> enters = rich<S>(s.lobe == EnumOf<F, Lobe>(Lobe::kSubsurface));
  to.guide = s.weight * sqr(s.eta);
  if (any(enters)) to.guide = select(enters, s.weight * subsurface_color, to.guide);
  to.guide = select(to.goes_on, to.guide, Vec3<F>(0));
  to.is_vertex = (!to.goes_on) | aimed | enters | (s.pdf > 0);
  if (any((share > 0) & (to.goes_on | aimed)))
    to.goes_on = mix_casters(b, casters, aimed, choice, u, to.goes_on, s);
  to.carried = {carried.throughput * s.weight, carried.radiance_scale * sqr(s.eta)};
  to.spread = lobe_spread(s.pdf);
  // Light that enters a body has its roulette where it leaves.
  to.goes_on = to.goes_on & survives(to.carried.throughput, to.carried.radiance_scale,
                                     BoolOf<F>(begun & !enters), survival);
  return to;
}

/// An albedo seen along the path. One that carries a single wavelength sees no hue.
KERNEL vec3 guide_albedo(const Path& path, vec3 albedo) {
  vec3 seen = path.throughput * albedo * path.radiance_scale;
  if (kRich && path.dispersed) seen = vec3((seen.x + seen.y + seen.z) / 3);
  return glm::min(seen, vec3(1));
}
/// Denoising guides, at the first vertex that is not a perfect mirror.
KERNEL void record_guides(Path& path, vec3 weight, vec3 normal, SampleValues& sample) {
  sample.albedo = guide_albedo(path, weight);
  sample.normal = normal;
  path.guided = true;
}
/// The same, where a surface scatters no light.
KERNEL void record_guides(const Path& path, const Vertex& v, SampleValues& sample) {
  if (path.guided) return;
  const Surface& s = v.surface;
  sample.albedo = guide_albedo(path, glm::min(v.emission, vec3(1)));
  sample.normal = dot(path.ray.direction, s.ng) <= 0 ? s.ns : -s.ns;
}

/// True at the first vertex, which decides the planes that the path's light belongs to, if a film
/// has these.
template <Tracer T>
KERNEL bool takes_route(const PathContext<T>& c, const Path& path) {
  return path.edges == 1 && wants_rich(c.film, kLightPlaneSet);
}
KERNEL Route route_of(const BsdfSample& s, bool transmitted) {
  return {share_of(s.diffuse, s.weight),
          transmitted ? FirstVertex::kTransmits : FirstVertex::kReflects};
}

/// The path goes on from the vertex in a direction that has been chosen; false when it ends.
template <Tracer T>
HELIO_ALWAYS_INLINE KERNEL bool follow(const PathContext<T>& c, Path& path, Vertex& v,
                                       const DirectionOf<float>& to, SampleValues& sample) {
  const BsdfSample& s = to.sample;
  if (!path.guided && to.is_vertex) record_guides(path, to.guide, v.bsdf.frame.n, sample);
  if (!to.goes_on) return false;
  path.throughput = to.carried.throughput;
  path.radiance_scale = to.carried.radiance_scale;
  if (kRich && s.lobe == Lobe::kSubsurface) {
    return scatter_inside(c, path, v, sample) && path.edges <= c.settings.max_depth;
  }
  const bool diffuse = s.lobe == Lobe::kDiffuse || s.lobe == Lobe::kDiffuseTransmission;
  const bool transmitted =
      s.lobe == Lobe::kTransmission || (kRich && s.lobe == Lobe::kDiffuseTransmission);
  if (kRich && transmitted && disperses(*v.surface.material, v.material)) {
    path.throughput *= color_of_crossing(c, path, v);
    path.dispersed = true;
  }
  if (takes_route(c, path)) path.route = route_of(s, transmitted);
  if (transmitted && has_media(c.scene)) cross_surface(path.inside, v.surface, v.material, s.wi);
  const u32 mask = diffuse ? kDiffuseRay : transmitted ? kTransmissionRay : kGlossyRay;
  go_on(c, path, {offset_point(v.surface, s.wi), s.wi, s.pdf, to.spread, mask, v.receiver});
  return path.edges <= c.settings.max_depth;
}

/// True if the path's vertex is its last: it is met, and takes no light.
KERNEL bool is_last(const Settings& settings, const Path& path) {
  return path.edges >= settings.max_depth;
}

/// The surface that the path has come to scatters light; false when the path ends.
///
/// light   what comes straight from one light is left there; null: none is taken
template <Tracer T>
HELIO_ALWAYS_INLINE KERNEL bool scatter(const PathContext<T>& c, Path& path, Vertex& v,
                                        SampleValues& sample, LaterLight* light) {
  const Surface& s = v.surface;
  ShadingPoint at = shading_point(c.scene, s, v.material, -path.ray.direction);
  at.outside = v.boundary.outside;
  CasterCones& casters = *v.casters;
  if (!set_scattering(c.scene, v.material, at, s.p, looks_for_casters(c.scene, path), v.bsdf,
                      casters)) {
    record_guides(path, v, sample);
    return false;
  }
  set_receiver(v, c.time);
  v.receiver.surface_share = surface_share(c.scene, v.receiver);
  if (light && !is_last(c.settings, path) && has_lights(c.scene) && has_smooth_lobe(v.bsdf))
    sample_light(c, path, v, sample, *light);
  const bool chooses = casters.probability > 0 || chooses_lobe(v.bsdf);
  const float choice = chooses ? c.sampler.get1(vertex_pair(path, kChancePair)) : 0;
  const vec2 u = c.sampler.get2(vertex_pair(path, kScatterPair));
  const DirectionOf<float> to =
      choose_direction(v.bsdf, casters, v.material.subsurface_color, carried_by(path),
                       roulette_begins(c.settings, path), choice, u,
                       [&] { return c.sampler.get2(vertex_pair(path, kChancePair)).y; });
  return follow(c, path, v, to, sample);
}

/// True if the hemisphere above the vertex is open in a direction chosen by cosine.
template <Tracer T>
HELIO_GPU_NOINLINE KERNEL float open_hemisphere(const PathContext<T>& c, const Vertex& v,
                                                const Path& path, SampleValues& sample) {
  const Surface& s = v.surface;
  const float side = dot(path.ray.direction, s.ng) < 0 ? 1.0f : -1.0f;
  const u32 bits = c.sampler.hash_of(kOcclusionHash);
  const vec2 u(unit_float(bits), unit_float(hash32(bits)));
  const vec3 d = to_world(make_frame(s.ns * side), sample_cosine(u));
  if (dot(d, s.ng) * side <= 0) return 0;
  ++sample.rays;
  const Ray ray{offset_point(s, d), d, INFINITY, c.time, hole_key(c, kOcclusionHash)};
  return c.tracer.occluded(ray, kShadowRay) ? 0 : 1;
}

template <Tracer T>
KERNEL CatcherNumbers catcher_numbers(const PathContext<T>& c, const Path& path) {
  return {hole_key(c, kShadowHoleHash), c.sampler.get2(vertex_pair(path, kLightPair)),
          c.sampler.get2(vertex_pair(path, kScatterPair))};
}

/// Begins a sample with a ray of the camera: its path, and what does not need one.
template <Tracer T>
HELIO_ALWAYS_INLINE KERNEL Path begin_sample(const PathContext<T>& c, const Ray& ray,
                                             SampleValues& sample) {
  if (wants_rich(c.film, planes_from<SampleRich>())) {
    for (vec3& light : sample.light) light = vec3(0);
    sample.diffuse_color = vec3(0);
    sample.open = 1;
  }
  const Path path = path_along(c, ray, sample);
  sample.alpha = path.ray.t_max > 0 || !c.settings.transparent_background ? 1 : 0;
  if (kRich && c.film.catcher && has_lights(c.scene)) {
    sample.caught = see_catcher(CatcherScene<T>{c.scene, c.tracer, sample.rays}, path.ray,
                                catcher_numbers(c, path));
  }
  return path;
}

/// Distance that a path's ray may go.
struct Reach {
  float end;      // its own t_max
  Flight flight;  // through the medium that it starts in
};
/// Ends the path's ray where the medium that it starts in scatters its light.
template <Tracer T>
HELIO_ALWAYS_INLINE KERNEL Reach set_out(const PathContext<T>& c, Path& path) {
  const float end = path.ray.t_max;
  if (!is_filled(path.inside)) return {end, {INFINITY, vec3(0)}};
  const Flight flight = begin_flight(c, path);
  path.ray.t_max = min2(end, flight.distance);
  return {end, flight};
}

/// Sets the surface of a vertex at a hit.
struct SurfaceAt {
  const SceneView& scene;
  const Hit& hit;
  float time;

  HELIO_ALWAYS_INLINE KERNEL void operator()(Vertex& v) const {
    new (&v.surface)  // in place: these are large
        Surface(surface_at(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), time));
  }
};

/// Outcomes where a path's ray ends.
enum class Met : u8 { kEnd, kPassage, kSurface };

/// The path has set out and its ray has met something, or nothing: it ends there, goes on, or comes
/// to a surface whose light it is to scatter().
///
/// v         the surface, if it meets one
/// surface   sets that of v where the ray has met something; called only if the path comes there
/// sky       where the ray leaves the scene: its place in the dome if that is known, else null
template <Tracer T, class S>
HELIO_ALWAYS_INLINE KERNEL Met arrive(const PathContext<T>& c, Path& path, const Reach& reach,
                                      const Hit& hit, Vertex& v, SampleValues& sample,
                                      const S& surface, const DomePlace* sky = nullptr) {
  const auto passes = [](bool goes_on) { return goes_on ? Met::kPassage : Met::kEnd; };
  ++sample.rays;
  Collision at{};
  const bool collides = meets_volume(c, path, hit.t, at);
  if (is_filled(path.inside)) {
    path.ray.t_max = reach.end;
    const Flown flown = end_flight(c, path, reach.flight, collides ? at.t : hit.t, sample);
    if (flown != Flown::kPassed) return passes(flown == Flown::kScattered);
  }
  if (kRich && collides) return passes(hit_volume(c, path, at, sample));
  if (hit.instance == kNone) {
    miss(c, path, sky, sample);
    return Met::kEnd;
  }
  sample.hit = true;
  surface(v);
  hit_surface(c, path, hit, v, sample);
  if (kRich && v.boundary.meeting != Meeting::kScatters) return passes(pass_surface(path, v));
  if (path.edges == 1 && wants_rich(c.film, plane_bit(Plane::AMBIENT_OCCLUSION))) {
    sample.open = open_hemisphere(c, v, path, sample);
  }
  if (path.edges == 1 && wants_rich(c.film, plane_bit(Plane::DIFFUSE_COLOR))) {
    const MaterialValues& m = v.material;
    sample.diffuse_color =
        m.base_color * ((1 - m.metallic) * (1 - m.transmission) * (1 - m.diffuse_transmission));
  }
  if (is_last(c.settings, path) && path.guided) return Met::kEnd;
  if (!v.surface.material->unlit && !is_black(v.material)) return Met::kSurface;
  record_guides(path, v, sample);
  return Met::kEnd;
}

/// arrive() and, at a surface, scatter(): false when the path ends.
template <Tracer T>
HELIO_ALWAYS_INLINE KERNEL bool advance(const PathContext<T>& c, Path& path, const Reach& reach,
                                        const Hit& hit, SampleValues& sample, LaterLight* light) {
  CasterCones casters;
  Vertex v;
  v.casters = &casters;
  const Met met = arrive(c, path, reach, hit, v, sample, SurfaceAt{c.scene, hit, c.time});
  return met == Met::kSurface ? scatter(c, path, v, sample, light) : met == Met::kPassage;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
