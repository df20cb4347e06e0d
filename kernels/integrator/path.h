// The integrator: unbiased path tracing with next event estimation and multiple importance
// sampling. render_pixel() is the whole of it, one path after the other; backends take the same
// steps for many paths side by side (lockstep.h on a CPU, wave.h on a GPU).
#pragma once

#include <new>

#include "kernels/integrator/catcher.h"
#include "kernels/integrator/first_ray.h"
#include "kernels/integrator/path_volume.h"
#include "kernels/integrator/subsurface.h"

namespace heliograph::kernels::inline HELIO_ISA {

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
  path.cone = pixel_cone(c.camera);
  path.route = {vec3(0), FirstVertex::kReflects};
  path.passed = 0;
  path.boundaries = 0;
  if (has_media(c.scene)) path.inside = inside_at(c.scene, c.tracer, path.ray, sample.rays);
  return path;
}

/// Radiance of the dome where the path leaves the scene, weighted.
///
/// place   of the path's direction if it is known; else null
KERNEL vec3 met_dome(const SceneView& scene, const Path& path, const DomePlace* place) {
  const DomeView& dome = scene.dome;
  if (is_black(dome.radiance) || (path.edges == 1 && !dome.camera_visible)) return vec3(0);
  DomePlace at{vec2(0), 0};
  if (dome.texture != kNone) at = place ? *place : dome_place(dome, path.ray.direction);
  float weight = 1;
  if (path.pdf > 0 && dome.probability > 0) {
    const float pdf = dome_pdf(dome, path.from, path.ray.direction, at);
    weight = mis_weight(path.pdf, sky_share(path.from) * pdf);
  }
  return dome_radiance(scene, at.uv) * weight;
}

/// Radiance of a sun where the path leaves the scene, weighted; 0 unless it meets the sun.
KERNEL vec3 met_sun(const SunView& sun, const Path& path) {
  if (!(sun.visibility & path.mask) || !in_sun(sun, path.ray.direction, path.ray.time))
    return vec3(0);
  if (path.pdf <= 0) return sun.radiance;
  if (!shows_to_all(sun.visibility)) return vec3(0);
  return sun.radiance * mis_weight(path.pdf, sky_share(path.from) * sun_pdf(sun));
}

/// The path leaves the scene.
template <Tracer T>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL void miss(const PathContext<T>& c, const Path& path,
                                                 const DomePlace* place, SampleValues& sample) {
  if (path.edges == 1 && c.settings.transparent_background) {
    const vec3 held = vec3(1) - path.throughput;  // by media on the way; exactly 0 without
    sample.alpha = (held.x + held.y + held.z) / 3;
    return;
  }
  const auto add = [&](vec3 radiance, u32 group) {
    collect(c, sample, {path.throughput * radiance, path.edges, true, group}, path.route);
  };
  add(met_dome(c.scene, path, place), c.scene.dome.light_group);
  for (u32 i = 0; i < c.scene.sun_count; ++i) {
    add(met_sun(c.scene.suns[i], path), c.scene.suns[i].light_group);
  }
}

/// Weight of light that the path met by itself where sample_light could have found it too.
KERNEL float emission_weight(const SceneView& scene, const Path& path, const Hit& hit, u32 light) {
  if (path.pdf <= 0 || light == kNone) return 1;
  if (!shows_to_all(scene.instances[hit.instance].visibility)) return 0;
  Hit from_vertex = hit;
  from_vertex.t += path.passed;
  return mis_weight(path.pdf, light_pdf(scene, path.from, from_vertex, path.ray.direction, light));
}

/// The path meets a surface: finds out what it is and counts what it emits.
template <Tracer T>
HELIO_ALWAYS_INLINE KERNEL void hit_surface(const PathContext<T>& c, Path& path, const Hit& hit,
                                            Vertex& v, SampleValues& sample) {
  new (&v.surface)  // in place: these are large
      Surface(surface_at(c.scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), c.time));
  const Surface& s = v.surface;
  path.cone.width += path.cone.spread * hit.t;
  new (&v.material) MaterialValues(material_at(c.scene, s, ~kAlphaBit, path.cone.width));
  if (path.blurred && c.settings.regularize) regularize(v.material);
  v.boundary = boundary_at(c.scene, path.inside, s, path.ray.direction);
  if (v.boundary.meeting == Meeting::kAbsent) return;
  const vec3 emission = emitted(c.scene, s, v.material, -path.ray.direction);
  const vec3 own = shown(s, v.material);
  v.emission = emission + own;
  if (is_black(v.emission)) return;
  const vec3 light = emission * emission_weight(c.scene, path, hit, s.light) + own;
  const u32 group = s.instance->light_group;
  collect(c, sample, {path.throughput * light, path.edges, false, group}, path.route);
}

/// Finds out how the surface scatters light; false when it does not.
template <Tracer T>
HELIO_ALWAYS_INLINE KERNEL bool set_scattering(const PathContext<T>& c, const Path& path, Vertex& v,
                                               SampleValues& sample) {
  const Surface& s = v.surface;
  const vec3 wo = -path.ray.direction;
  if (!s.material->unlit) {
    ShadingPoint at = shading_point(c.scene, s, v.material, wo);
    at.outside = v.boundary.outside;
    set_bsdf(v.bsdf, v.material, at);
    if (scatters(v.bsdf)) {
      v.receiver = receiver_of(c.scene, v, c.time);
      if (path.edges <= kCasterEdges && v.bsdf.diffuse_probability > 0 &&
          c.scene.caster_count > 0) {
        gather_caustic_targets(*v.casters, c.scene, s.p, v.bsdf.frame.n);
      }
      return true;
    }
  }
  if (!path.guided) {
    sample.albedo = path.throughput * path.radiance_scale * glm::min(v.emission, vec3(1));
    sample.normal = dot(wo, s.ng) >= 0 ? s.ns : -s.ns;
  }
  return false;
}

/// Denoising guides, at the first vertex that is not a perfect mirror.
///
/// weight   of the light that goes on
KERNEL void record_guides(Path& path, vec3 weight, vec3 normal, SampleValues& sample) {
  sample.albedo = glm::min(path.throughput * weight * path.radiance_scale, vec3(1));
  sample.normal = normal;
  path.guided = true;
}
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL void record_guides(Path& path, const Vertex& v,
                                                          const BsdfSample* s,
                                                          SampleValues& sample) {
  vec3 weight(0);
  if (s) {
    const bool enters = s->lobe == Lobe::kSubsurface;
    weight = s->weight * (enters ? v.material.subsurface_color : vec3(sqr(s->eta)));
  }
  record_guides(path, weight, v.bsdf.frame.n, sample);
}

/// Turns a sample of the surface's own into one of directions towards casters, too.
///
/// aimed, choice   whether it is to go to a caster, and uniform in [0, 1) which
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL bool mix_casters(const Vertex& v, bool aimed, float choice,
                                                        vec2 u, BsdfSample& s) {
  if (aimed) {
    const CasterDirectionOf<float> to = sample_casters(*v.casters, choice, u);
    const BsdfValue f = evaluate_bsdf(v.bsdf, to.wi);
    if (!(f.pdf > 0) || dot(v.bsdf.ng, to.wi) <= 0) return false;
    const float diffuse = v.bsdf.diffuse_probability * dot(v.bsdf.frame.n, to.wi) * kInvPi;
    const float scale = 1 / f.pdf;
    s = {to.wi,
         (f.diffuse + f.glossy) * scale,
         f.diffuse * scale,
         f.pdf,
         1,
         to.rest * f.pdf < diffuse ? Lobe::kDiffuse : Lobe::kGlossy};
  }
  if (!(s.pdf > 0)) {
    s.weight *= 1 / (1 - v.casters->probability);
    return true;
  }
  const float pdf = scatter_pdf(v, s.wi, s.pdf);
  s.weight *= s.pdf / pdf;
  s.diffuse *= s.pdf / pdf;
  s.pdf = pdf;
  return true;
}

/// The path goes on in a direction of the surface's choice, or towards a caster; false when it
/// ends. The vertex becomes the one that it goes on from.
template <Tracer T>
KERNEL bool scatter(const PathContext<T>& c, Path& path, Vertex& v, SampleValues& sample) {
  const float share = v.casters->probability;
  const bool chooses = share > 0 || chooses_lobe(v.bsdf);
  float choice = chooses ? c.sampler.get1(vertex_pair(path, kChancePair)) : 0;
  const bool aimed = choice < share;
  choice = aimed ? rescale_uniform(choice, share) : rescale_uniform(choice - share, 1 - share);
  const vec2 u = c.sampler.get2(vertex_pair(path, kScatterPair));
  BsdfSample s;
  bool goes_on = sample_bsdf(v.bsdf, choice, u, s);
  if (!path.guided && (!goes_on || aimed || s.lobe == Lobe::kSubsurface || s.pdf > 0)) {
    record_guides(path, v, goes_on ? &s : nullptr, sample);
  }
  if (share > 0 && (goes_on || aimed)) goes_on = mix_casters(v, aimed, choice, u, s);
  if (!goes_on) return false;
  path.throughput *= s.weight;
  if (kRich && s.lobe == Lobe::kSubsurface) return scatter_inside(c, path, v, sample);
  const bool transmitted = s.lobe == Lobe::kTransmission;
  if (path.edges == 1 && wants_rich(c.film, kLightPlaneSet)) {
    path.route = {share_of(s.diffuse, s.weight),
                  transmitted ? FirstVertex::kTransmits : FirstVertex::kReflects};
  }
  path.radiance_scale *= sqr(s.eta);
  if (transmitted && has_media(c.scene)) cross_surface(path.inside, v.surface, v.material, s.wi);
  const u32 mask = s.lobe == Lobe::kDiffuse ? kDiffuseRay
                   : transmitted            ? kTransmissionRay
                                            : kGlossyRay;
  go_on(c, path, {offset_point(v.surface, s.wi), s.wi, s.pdf, mask, v.receiver});
  return survives(c, path);
}

/// Whether the hemisphere above the vertex is open in a direction chosen by cosine.
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

/// How far a path's ray may go.
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

/// The path has set out and its ray has met something, or nothing. Returns whether it goes on.
///
/// light   (path, vertex): takes light at the vertex straight from one light
/// take    (path, vertex): whether somebody else makes the path go on from there
/// sky     where the ray leaves the scene: its place in the dome if that is known, else null
template <Tracer T, class Light, class Take>
HELIO_ALWAYS_INLINE KERNEL bool arrive(const PathContext<T>& c, Path& path, const Reach& reach,
                                       const Hit& hit, SampleValues& sample, const Light& light,
                                       const Take& take, const DomePlace* sky = nullptr) {
  ++sample.rays;
  Collision at{};
  const bool collides = meets_volume(c, path, hit.t, at);
  if (is_filled(path.inside)) {
    path.ray.t_max = reach.end;
    const Flown flown = end_flight(c, path, reach.flight, collides ? at.t : hit.t, sample);
    if (flown != Flown::kPassed) return flown == Flown::kScattered;
  }
  if (kRich && collides) return hit_volume(c, path, at, sample);
  if (hit.instance == kNone) {
    miss(c, path, sky, sample);
    return false;
  }
  CasterCones casters;
  Vertex v;
  v.casters = &casters;
  sample.hit = true;
  hit_surface(c, path, hit, v, sample);
  if (kRich && v.boundary.meeting != Meeting::kScatters) return pass_surface(path, v);
  if (path.edges == 1 && wants_rich(c.film, plane_bit(Plane::AMBIENT_OCCLUSION))) {
    sample.open = open_hemisphere(c, v, path, sample);
  }
  if (path.edges == 1 && wants_rich(c.film, plane_bit(Plane::DIFFUSE_COLOR))) {
    const MaterialValues& m = v.material;
    sample.diffuse_color = m.base_color * ((1 - m.metallic) * (1 - m.transmission));
  }
  const bool last = path.edges >= c.settings.max_depth;
  if (last && path.guided) return false;
  if (!last && take(path, v)) return false;
  if (!set_scattering(c, path, v, sample)) return false;
  if (!last && has_lights(c.scene) && has_smooth_lobe(v.bsdf)) light(path, v);
  return scatter(c, path, v, sample) && path.edges <= c.settings.max_depth;
}

/// Takes no vertex, see arrive().
struct TakesNone {
  KERNEL bool operator()(const Path&, const Vertex&) const { return false; }
};

/// Traces one path and all the light it meets.
template <Tracer T>
KERNEL SampleValues trace_path(const PathContext<T>& c, u32 x, u32 y) {
  SampleValues sample;
  const auto light = [&](const Path& path, const Vertex& v) { sample_light(c, path, v, sample); };
  Path path = begin_sample(c, first_ray(c, x, y), sample);
  while (path.ray.t_max > 0) {  // not even once where the camera sees nothing
    const Reach reach = set_out(c, path);
    const Hit hit = c.tracer.closest(path.ray, path.mask);
    if (!arrive(c, path, reach, hit, sample, light, TakesNone{})) break;
  }
  return sample;
}

/// Adds samples [first_sample, first_sample + sample_count) of pixel (x, y) to the film; returns
/// rays traced.
template <Tracer T>
KERNEL u32 render_pixel(const SceneView& scene, const CameraView& camera, const Settings& settings,
                        const T& tracer, const FilmView& film, u32 x, u32 y, u32 first_sample,
                        u32 sample_count) {
  const u64 key = pixel_key(settings.seed, x, y);
  const u64 pixel = u64(y) * film.width + x;
  u32 rays = 0;
  for (u32 i = first_sample; i < first_sample + sample_count; ++i) {
    const Sampler sampler(key, i);
    const float time = path_time(camera, sampler, x, y);
    const CameraAt now(camera, time);
    const PathContext<T> context{scene, now.camera(), settings, tracer, film, sampler, time, pixel};
    const SampleValues sample = trace_path(context, x, y);
    write_sample(film, pixel, sample, (i + 1) % kBlock == 0);
    rays += sample.rays;
  }
  return rays;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
