// Suns: discs of light infinitely far away. Called by light.h and path.h.
#pragma once

#include "kernels/core/warp.h"
#include "kernels/geometry/motion.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// To the middle of the sun at a time.
KERNEL vec3 sun_direction(const SunView& sun, float time) {
  if (sun.segments == 0) return sun.direction;
  const Segment s = segment_at(sun.segments, time);
  const MotionKey* key = sun.motion_keys + s.index;
  return normalize(interpolate(key[0], key[1], s.u)[2]);
}

/// True if a unit direction meets the sun at a time.
KERNEL bool in_sun(const SunView& sun, vec3 direction, float time) {
  const vec3 d = direction - sun_direction(sun, time);
  return dot(d, d) <= 2 * sun.one_minus_cos;
}

/// Density [1/sr] of each direction to the sun, the choice of the sun included.
KERNEL float sun_pdf(const SunView& sun) { return sun.probability / (2 * kPi * sun.one_minus_cos); }

/// Uniform in the sun's solid angle.
KERNEL vec3 sample_sun(const SunView& sun, float time, vec2 u) {
  return normalize(sample_cone(sun_direction(sun, time), sun.one_minus_cos, u));
}

}  // namespace heliograph::kernels::inline HELIO_ISA
