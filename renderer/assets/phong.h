// Phong's and Blinn's materials as roughness and specular. Used by MTL, COLLADA and the formats of
// assimp.
#pragma once

#include <algorithm>
#include <cmath>

#include "renderer/base/types.h"

namespace heliograph::assets {

/// Roughness of a shininess (exponent), 0 or more. Source: Walter et al. 2007, "Microfacet Models
/// for Refraction", section 5.2: alpha^2 = 2 / (exponent + 2).
[[nodiscard]] inline float roughness_of(float shininess) {
  return std::pow(2 / (std::max(shininess, 0.0f) + 2), 0.25f);
}
/// The parameter `specular` of a specular colour, before it is clamped.
[[nodiscard]] inline float specular_of(vec3 color) { return 2 * (color.x + color.y + color.z) / 3; }

}  // namespace heliograph::assets
