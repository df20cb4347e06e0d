#pragma once

#include <cmath>

#include "renderer/base/types.h"

namespace heliograph {

/// Whether f32 shows already that invertible() holds, as it does for nearly all: axes of 1e-4 to
/// 1e4, whose volume is off by 2e-6 of their box at most, and is 1e-4 of it.
[[nodiscard]] inline bool plainly_invertible(const mat4x3& m) {
  const float x = glm::dot(m[0], m[0]), y = glm::dot(m[1], m[1]), z = glm::dot(m[2], m[2]);
  const float determinant = glm::dot(m[0], glm::cross(m[1], m[2]));
  const auto is_medium = [](float square) { return square >= 1e-8f && square <= 1e8f; };
  return is_medium(x) && is_medium(y) && is_medium(z) &&
         determinant * determinant >= 1e-8f * x * y * z;
}

/// Whether f32 can invert what an entity's pose says: three independent axes whose volume lies
/// between 1e-30 and 1e30 and is at least a millionth of a box of their lengths.
[[nodiscard]] inline bool invertible(const mat4x3& m) {
  const glm::dvec3 x(m[0]), y(m[1]), z(m[2]);
  const double determinant = std::abs(glm::dot(x, glm::cross(y, z)));
  const double box = glm::length(x) * glm::length(y) * glm::length(z);
  return determinant >= 1e-30 && determinant <= 1e30 && determinant >= 1e-6 * box;
}

}  // namespace heliograph
