// Steps of a path in volumes. Called by path.h.
#pragma once

#include "kernels/path_state.h"
#include "kernels/phase.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Whether the path collides in a volume before t_max.
template <Tracer T>
KERNEL bool meets_volume(const PathContext<T>& c, const Path& path, float t_max, Collision& at) {
  if (c.scene.volume_count == 0) return false;
  const u32 seed = c.sampler.hash_of(kCollisionHash + path.edges);
  at = collide(c.scene, path.ray, path.mask, min2(t_max, path.ray.t_max), seed);
  return at.volume != kNone;
}

/// The path collides in a volume: counts what glows there, takes light, and goes on in a direction
/// of the medium's choice; false when it ends.
template <Tracer T>
KERNEL bool hit_volume(const PathContext<T>& c, Path& path, const Collision& at,
                       SampleValues& sample) {
  const VolumeView& volume = c.scene.volumes[at.volume];
  const Medium medium = medium_at(c.scene, volume, path.ray, at.t);
  if (!is_black(medium.emission)) {
    const u32 group = volume.instance.light_group;
    collect(c, sample, {path.throughput * medium.emission, path.edges, false, group}, path.route);
  }
  if (!path.guided) {
    sample.albedo = glm::min(path.throughput * medium.albedo * path.radiance_scale, vec3(1));
    path.guided = true;  // a medium has no normal
  }
  if (path.edges >= c.settings.max_depth || is_black(medium.albedo)) return false;
  const vec3 forward = path.ray.direction;
  const Receiver from{path.ray.origin + forward * at.t, vec3(0), Facing::kAny, c.time};
  const Route route{vec3(0), FirstVertex::kInVolume};
  LightSample light;
  if (has_lights(c.scene) && choose_light(c, path, from, light) &&
      (light.visibility & kVolumeRay)) {
    const float f = phase_density(volume.anisotropy, dot(forward, light.direction));
    receive_light(c, path, light, from.p, {medium.albedo * f, f, route}, sample);
  }
  const vec2 u = c.sampler.get2(vertex_pair(path, kScatterPair));
  const vec3 direction = sample_phase(volume.anisotropy, forward, u);
  if (path.edges == 1) path.route = route;
  path.throughput *= medium.albedo;
  path.pdf = phase_density(volume.anisotropy, dot(forward, direction));
  path.from = from;
  path.blurred = true;
  path.cone.width += path.cone.spread * at.t;
  path.cone.spread = max2(path.cone.spread, lobe_spread(path.pdf));
  path.mask = kVolumeRay;
  path.ray = {from.p, direction, INFINITY, c.time, hole_key(c, kHoleHash + path.edges)};
  ++path.edges;
  return survives(c, path);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
