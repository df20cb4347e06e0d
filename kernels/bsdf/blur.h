// Blur of what a path sees: textures over its cone; on request rougher lobes. Called by path.h.
#pragma once

#include "kernels/core/math.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Neighbourhood that a ray stands for: `width` metres across at its origin, which grows by
/// `spread` each metre. Textures are filtered over it.
struct Cone {
  float width;
  float spread;
};

/// The width of a scattered ray's cone over that of a lobe.
inline constexpr float kLobeShare = 0.2f;
/// The spread of a ray that a lobe has chosen: a part of the solid angle that the lobe covers.
///
/// After Bekaert, Slusallek, Cools, Havran and Seidel 2003, "A custom designed density estimation
/// method for light transport", which takes footprints from sampling densities.
template <class F>
KERNEL F lobe_spread(F pdf) {
  return select(pdf > 0, kLobeShare / sqrt(pdf), F(0));
}

/// Makes glossy lobes rougher, so that paths which light sampling cannot find are not fireflies.
///
/// Source: Kaplanyan and Dachsbacher 2013, "Path Space Regularization for Holistic and Robust Light
/// Transport"; the rule is pbrt-v4's: alpha below 0.3 becomes 2 alpha, within [0.1, 0.3].
KERNEL void regularize(float& roughness) {
  const float alpha = sqr(roughness);
  if (alpha < 0.3f) roughness = std::sqrt(min2(max2(2 * alpha, 0.1f), 0.3f));
}
KERNEL void regularize(MaterialValues& material) {
  regularize(material.roughness);
  regularize(material.clearcoat_roughness);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
