// The steps of a path through media: flights, and what scatters light where there is no surface.
// Called by path.h.
#pragma once

#include "kernels/integrator/direct_light.h"
#include "kernels/media/phase.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A point of a medium that scatters light which came along `direction` (unit).
struct MediumPoint {
  Receiver receiver;
  vec3 direction;
  float g;
};

KERNEL BsdfValue scattered(const MediumPoint& at, vec3 wi, u32 visibility) {
  const float density = phase_density(at.g, dot(at.direction, wi));
  return {vec3(visibility & kVolumeRay ? density : 0), vec3(0), density};
}
KERNEL vec3 leave_towards(const MediumPoint& at, vec3) { return at.receiver.p; }
KERNEL void cross_towards(const MediumPoint&, vec3, Inside&) {}
KERNEL FirstVertex first_vertex(const MediumPoint&, vec3) { return FirstVertex::kInVolume; }

/// A medium with mean cosine g scatters the path `distance` metres along its ray; its throughput
/// counts that already. False when it ends there.
template <Tracer T>
KERNEL bool scatter_in_medium(const PathContext<T>& c, Path& path, float distance, float g,
                              SampleValues& sample) {
  sample.hit = true;
  path.cone.width += path.cone.spread * distance;
  if (!path.guided) {
    sample.albedo = glm::min(path.throughput * path.radiance_scale, vec3(1));
    path.guided = true;
  }
  if (path.edges >= c.settings.max_depth || is_black(path.throughput)) return false;
  const vec3 p = path.ray.origin + path.ray.direction * distance;
  const MediumPoint at{receiver_at(c.scene, p, vec3(0), Facing::kAny, c.time), path.ray.direction,
                       g};
  if (has_lights(c.scene)) sample_light(c, path, at, sample);
  if (path.edges == 1) path.route = {vec3(0), FirstVertex::kInVolume};
  const vec3 wi = sample_phase(g, at.direction, c.sampler.get2(vertex_pair(path, kScatterPair)));
  const float pdf = phase_density(g, dot(at.direction, wi));
  go_on(c, path, {p, wi, pdf, lobe_spread(pdf), kVolumeRay, at.receiver});
  return survives(c, path);
}

/// How far the path's ray, which starts in a medium, goes before the medium scatters its light.
template <Tracer T>
HELIO_RARE KERNEL Flight begin_flight(const PathContext<T>& c, const Path& path) {
  const Interior& medium = interior_in(path.inside);
  if (is_black(medium.scattering)) return {INFINITY, vec3(0)};
  return choose_flight(medium, path.throughput, c.sampler.get2(flight_pair(path)));
}

enum class Flown : u8 { kPassed, kScattered, kEnded };
/// The light flies through the medium, up to what stands in its way after `distance` (infinite: up
/// to the end of its ray), or is scattered before.
template <Tracer T>
HELIO_RARE KERNEL Flown end_flight(const PathContext<T>& c, Path& path, const Flight& flight,
                                   float distance, SampleValues& sample) {
  const Interior& medium = interior_in(path.inside);
  const bool passes = distance < INFINITY || flight.distance >= path.ray.t_max;
  if (is_black(medium.scattering)) {
    path.throughput *= transmittance(medium, distance);
  } else {
    path.throughput *=
        passes ? weight_of_passing(medium, flight, distance) : weight_of_scattering(medium, flight);
  }
  if (!(max_component(path.throughput) > 0)) return Flown::kEnded;
  if (passes) return Flown::kPassed;
  const bool goes_on = scatter_in_medium(c, path, flight.distance, medium.g, sample);
  return goes_on ? Flown::kScattered : Flown::kEnded;
}

/// The path goes straight on through a surface that does not scatter; false when it ends.
HELIO_RARE KERNEL bool pass_surface(Path& path, const Vertex& v) {
  if (path.boundaries++ >= kMostPassed) return false;
  if (v.boundary.meeting == Meeting::kPasses) path.throughput *= tint_of_crossing(v.material);
  cross_surface(path.inside, v.surface, v.material, path.ray.direction);
  const vec3 origin = offset_point(v.surface, path.ray.direction);
  const float distance = dot(origin - path.ray.origin, path.ray.direction);
  path.passed += distance;
  path.ray.t_max -= distance;
  path.ray.origin = origin;
  return max_component(path.throughput) > 0;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
