#include "renderer/assets/flat.h"

#include <algorithm>

namespace heliograph::assets {
namespace {

/// The direction across the plane that three vectors span; 0: they span none.
glm::dvec3 across(const glm::dmat3& vectors) {
  glm::dvec3 longest(0);
  for (int i = 0; i < 3; ++i) {
    const glm::dvec3 normal = glm::cross(vectors[i], vectors[(i + 1) % 3]);
    if (glm::length(normal) > glm::length(longest)) longest = normal;
  }
  const double length = glm::length(longest);
  return length > 0 ? longest / length : longest;
}

}  // namespace

std::optional<mat4x3> with_thickness(const mat4x3& pose, double share) {
  if (invertible(pose)) return pose;
  glm::dmat3 linear(pose);
  const double size =
      std::max({glm::length(linear[0]), glm::length(linear[1]), glm::length(linear[2])});
  // The direction that becomes 0 is turned across the plane that the others become.
  const glm::dmat3 thick =
      share * size * glm::outerProduct(across(linear), across(glm::transpose(linear)));
  const bool mirrors = glm::determinant(linear + thick) < 0;
  linear += mirrors ? -thick : thick;
  const mat3 rounded(linear);
  const mat4x3 out(rounded[0], rounded[1], rounded[2], pose[3]);
  return invertible(out) ? std::optional(out) : std::nullopt;
}

}  // namespace heliograph::assets
