// Suns: discs of light infinitely far away. Called by light.h and path.h.
#pragma once

#include "kernels/scene_view.h"
#include "kernels/warp.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Whether a unit direction meets the sun.
KERNEL bool in_sun(const SunView& sun, vec3 direction) {
  const vec3 d = direction - sun.direction;
  return dot(d, d) <= 2 * sun.depth;
}

/// Density [1/sr] of each direction to the sun, the choice of the sun included.
KERNEL float sun_pdf(const SunView& sun) { return sun.probability / (2 * kPi * sun.depth); }

/// Uniform in the sun's solid angle.
KERNEL vec3 sample_sun(const SunView& sun, vec2 u) {
  const float drop = u.x * sun.depth;
  const float r = safe_sqrt(drop * (2 - drop));
  const SinCos phi = sincos_turns(u.y);
  return normalize(to_world(make_frame(sun.direction), vec3(r * phi.cos, r * phi.sin, 1 - drop)));
}

}  // namespace heliograph::kernels::inline HELIO_ISA
