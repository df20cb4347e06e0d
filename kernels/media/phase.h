// Phase functions: where a medium scatters light to. Called by who scatters light in a medium.
#pragma once

#include "kernels/core/warp.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// The largest |g| there is: beyond it float runs out.
inline constexpr float kMostAnisotropic = 0.99f;

/// Density [1/sr] of light that goes on in a direction at this cosine to the one it came along. It
/// integrates to 1 over the sphere; the mean cosine is g, in [-kMostAnisotropic, kMostAnisotropic].
///
/// Source: Henyey and Greenstein 1941, "Diffuse Radiation in the Galaxy".
KERNEL float phase_density(float g, float cosine) {
  const float d = 1 + g * g - 2 * g * cosine;
  return 0.25f * kInvPi * (1 - g * g) / (d * std::sqrt(d));
}

/// Chooses the direction in which light goes on that came along `direction`, with exactly that
/// density. Unit vectors.
///
/// The inverse of the cumulative distribution (Witt 1977), multiplied out so that nothing cancels
/// where g is near 0.
KERNEL vec3 sample_phase(float g, vec3 direction, vec2 u) {
  const float s = 1 - 2 * u.x;
  const float s2 = s * s;
  const float numerator = s * (1 + g * g) + 0.5f * g * (s2 + 3 + g * g * (s2 - 1));
  const float cosine = max2(min2(numerator / sqr(1 + g * s), 1.0f), -1.0f);
  const float sine = safe_sqrt(1 - cosine * cosine);
  const SinCos phi = sincos_turns(u.y);
  return to_world(make_frame(direction), vec3(sine * phi.cos, sine * phi.sin, cosine));
}

}  // namespace heliograph::kernels::inline HELIO_ISA
