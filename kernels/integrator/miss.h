// Light of the dome and of suns, where a path leaves the scene. Called by path.h.
#pragma once

#include "kernels/integrator/path_state.h"

namespace heliograph::kernels::inline HELIO_ISA {

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
    const float pdf = dome_pdf(dome, receiver_of(path), path.ray.direction, at);
    weight = mis_weight(path.pdf, sky_share(receiver_of(path)) * pdf);
  }
  return dome_radiance(scene, at.uv) * weight;
}

/// Radiance of a sun where the path leaves the scene, weighted; 0 unless it meets the sun.
KERNEL vec3 met_sun(const SunView& sun, const Path& path) {
  if (!(sun.visibility & path.mask) || !in_sun(sun, path.ray.direction, path.ray.time))
    return vec3(0);
  if (path.pdf <= 0) return sun.radiance;
  if (!shows_to_all(sun.visibility)) return vec3(0);
  return sun.radiance * mis_weight(path.pdf, sky_share(receiver_of(path)) * sun_pdf(sun));
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

}  // namespace heliograph::kernels::inline HELIO_ISA
