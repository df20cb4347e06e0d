// Light that enters a body, is scattered inside it many times and leaves elsewhere: a random walk.
// Called by path.h.
//
// Source: Chiang, Kutz and Burley 2016, "Practical and Controllable Subsurface Scattering for
// Production Path Tracing"; of the walk's colours, inside.h.
#pragma once

#include "kernels/integrator/direct_light.h"

namespace heliograph::kernels::inline HELIO_ISA {

// ---------------------------------------------------------------- the walk

/// Steps after which a walk is given up: of a white half-space, the worst there is, 0.5 % of the
/// light takes longer.
inline constexpr u32 kMostSteps = 65536;

/// The single-scattering albedo of a half-space that gives off the share `color` of diffuse light.
///
/// Source: van de Hulst 1980, "Multiple Light Scattering", volume 1; inverted by Kulla and Conty
/// 2017, "Revisiting Physically Based Shading at Imageworks", for isotropic scattering.
KERNEL float single_albedo(float color) {
  const float s =
      4.09712f + 4.20863f * color - std::sqrt(9.59217f + color * (41.6808f + color * 17.7126f));
  return clamp01(1 - s * s);
}

/// The medium inside a body. Its mean free paths are the material's radii, but so long that
/// rounding cannot carry light through the surface.
///
/// offset   Surface::offset where light enters
KERNEL Interior body_medium(const MaterialValues& m, float offset) {
  const vec3 extinction = vec3(1) / glm::max(m.subsurface_radius, vec3(64 * offset));
  const vec3 albedo(single_albedo(m.subsurface_color.x), single_albedo(m.subsurface_color.y),
                    single_albedo(m.subsurface_color.z));
  return {extinction, extinction * albedo, 0};
}

struct Walk {
  Hit hit;      // where it ends; none: it does not leave
  vec3 end;     // its last direction, unit
  vec3 weight;  // of its light
  u32 steps;    // rays that it took
};

/// Walks inside one instance to the first of its surfaces.
///
/// ray      starts just inside
template <Tracer T>
KERNEL Walk walk_body(const T& tracer, u32 instance, const Interior& medium, Ray ray,
                      HashStream random) {
  Walk walk{{INFINITY, kNone, 0, 0, 0}, ray.direction, vec3(1), 0};
  while (walk.steps < kMostSteps) {
    const float choice = random.next();
    const Flight flight = choose_flight(medium, walk.weight, vec2(choice, random.next()));
    ray.t_max = flight.distance;
    const Hit hit = tracer.closest_in(instance, ray);
    ++walk.steps;
    if (hit.instance != kNone) {
      walk.weight *= weight_of_passing(medium, flight, hit.t);
      walk.hit = hit;
      walk.end = ray.direction;
      return walk;
    }
    walk.weight *= weight_of_scattering(medium, flight);
    if (walk.steps > 8) {
      const float chance = max_component(walk.weight);
      if (chance < 1) {
        if (random.next() >= chance) return walk;
        walk.weight *= 1 / chance;
      }
    }
    if (!(max_component(walk.weight) > 0)) return walk;
    ray.origin += ray.direction * flight.distance;
    const float turn = random.next();
    ray.direction = sample_sphere(vec2(turn, random.next()));
  }
  return walk;
}

// ---------------------------------------------------------------- steps of a path

/// A surface that light leaves from inside a body.
struct BodyExit {
  const Vertex& v;
  Receiver receiver;
};
KERNEL BsdfValue scattered(const BodyExit& at, vec3 wi, u32 visibility) {
  const float leaving = visibility & kDiffuseRay ? leaving_body(at.v.bsdf, wi) : 0;
  const float density = max2(dot(at.v.bsdf.frame.n, wi), 0.0f) * kInvPi;
  return {vec3(leaving * density), vec3(0), density};
}
KERNEL vec3 leave_towards(const BodyExit& at, vec3 wi) { return offset_point(at.v.surface, wi); }
KERNEL void cross_towards(const BodyExit&, vec3, Inside&) {}
KERNEL FirstVertex first_vertex(const BodyExit&, vec3) { return FirstVertex::kWalksInside; }

/// The path walks inside the body from the vertex, which becomes where it leaves; false when it
/// does not.
template <Tracer T>
KERNEL bool cross_body(const PathContext<T>& c, Path& path, Vertex& v, SampleValues& sample) {
  const Surface& s = v.surface;
  HashStream random{c.sampler.hash_of(kWalkHash + path.edges)};
  const float u = random.next();
  vec3 d = -to_world(v.bsdf.frame, sample_cosine(vec2(u, random.next())));
  d -= v.bsdf.ng * max2(2 * dot(d, v.bsdf.ng), 0.0f);
  const Ray ray{offset_point(s, d), d, INFINITY, c.time, hole_key(c, kWalkHash + path.edges)};
  const u32 instance = u32(s.instance - c.scene.instances);
  const Walk walk = walk_body(c.tracer, instance, body_medium(v.material, s.offset), ray, random);
  sample.rays += walk.steps;
  if (walk.hit.instance == kNone) return false;
  path.throughput *= walk.weight;
  v.surface =
      surface_at(c.scene, instance, walk.hit.primitive, vec2(walk.hit.u, walk.hit.v), c.time);
  v.material = material_at(c.scene, v.surface, ~kAlphaBit);
  const float side = dot(walk.end, v.surface.ng) < 0 ? -1.0f : 1.0f;
  ShadingPoint at = shading_point(c.scene, v.surface, v.material, v.surface.ns * side);
  at.outside = v.boundary.outside;
  set_bsdf(v.bsdf, v.material, at);
  return true;
}

/// The path enters the body of a surface and goes on where it leaves.
template <Tracer T>
HELIO_RARE KERNEL bool scatter_inside(const PathContext<T>& c, Path& path, Vertex& v,
                                      SampleValues& sample) {
  if (path.edges >= c.settings.max_depth || !cross_body(c, path, v, sample)) return false;
  const BodyExit exit{v, receiver_at(c.scene, v.surface.p, v.bsdf.frame.n, Facing::kFront, c.time)};
  if (has_lights(c.scene)) sample_light(c, path, exit, sample);
  if (path.edges == 1) path.route = {vec3(0), FirstVertex::kWalksInside};
  const vec3 wi =
      to_world(v.bsdf.frame, sample_cosine(c.sampler.get2(vertex_pair(path, kScatterPair))));
  const BsdfValue f = scattered(exit, wi, kAllRays);
  if (!(f.pdf > 0 && f.diffuse.x > 0)) return false;
  path.throughput *= f.diffuse / f.pdf;
  go_on(c, path,
        {offset_point(v.surface, wi), wi, f.pdf, lobe_spread(f.pdf), kDiffuseRay, exit.receiver});
  return survives(c, path);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
