#pragma once

#include <cmath>

#include "renderer/base/types.h"

namespace heliograph {

/// True if f32 can invert an entity's pose: it has three independent axes whose volume lies
/// between 1e-30 and 1e30 and is at least a millionth of a box of their lengths.
[[nodiscard]] inline bool invertible(const mat4x3& m) {
  const glm::dvec3 x(m[0]), y(m[1]), z(m[2]);
  const double determinant = std::abs(glm::dot(x, glm::cross(y, z)));
  const double box = glm::length(x) * glm::length(y) * glm::length(z);
  return determinant >= 1e-30 && determinant <= 1e30 && determinant >= 1e-6 * box;
}

}  // namespace heliograph
