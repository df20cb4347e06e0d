// Steps of a path in volumes. Called by path.h.
#pragma once

#include "kernels/integrator/medium_path.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// True if the path collides in a volume before t_max.
template <Tracer T>
KERNEL bool meets_volume(const PathContext<T>& c, const Path& path, float t_max, Collision& at) {
  if (!kRich || c.scene.volume_count == 0) return false;
  const u32 seed = c.sampler.hash_of(kCollisionHash + path.edges) ^ hash32(path.boundaries);
  at = collide(c.scene, path.ray, path.mask, min2(t_max, path.ray.t_max), seed);
  return at.volume != kNone;
}

/// The path collides in a volume: counts what glows there, takes light, and goes on in a direction
/// of the medium's choice; false when it ends.
template <Tracer T>
HELIO_GPU_NOINLINE KERNEL bool hit_volume(const PathContext<T>& c, Path& path, const Collision& at,
                                          SampleValues& sample) {
  const VolumeView& volume = c.scene.volumes[at.volume];
  const Medium medium = medium_at(c.scene, volume, path.ray, at.t);
  if (!is_black(medium.emission)) {
    const u32 group = volume.instance.light_group;
    collect(c, sample, {path.throughput * medium.emission, path.edges, false, group}, path.route);
  }
  path.throughput *= medium.albedo;
  if (is_black(path.throughput)) {
    sample.hit = true;
    return false;
  }
  return scatter_in_medium(c, path, at.t, volume.anisotropy, sample);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
