#include "renderer/assets/poses.h"

#include <algorithm>
#include <cmath>

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

mat4x3 set_pose(PutEntity& put, const mat4x3& pose, const std::string& what, Builder& builder) {
  const auto thick = with_thickness(pose);
  if (!thick) {
    builder.warn(fmt::format("{} has a scale without an inverse and is hidden", what));
    put.visible = false;
    return mat4x3(1);
  }
  if (*thick != mat4x3(1)) put.pose = constant_pose(*thick);
  return *thick;
}

quat unit_rotation(const quat& rotation, const std::string& where, Builder& builder) {
  constexpr float kSmallest = 1e-6f;
  const float length = glm::length(rotation);
  if (length > kSmallest) return rotation / length;
  if (!std::isfinite(length)) refuse(where, "a rotation is not finite");
  builder.warn(fmt::format("{}: a rotation of length 0 turns nothing", where));
  return {1, 0, 0, 0};
}

mat4x3 compose_trs(vec3 translation, quat rotation, vec3 scale) {
  const mat3 r = glm::mat3_cast(rotation);
  return {r[0] * scale.x, r[1] * scale.y, r[2] * scale.z, translation};
}

mat4x3 thickened(const mat4x3& pose) {
  constexpr double kShare = 1e-4;
  return with_thickness(pose, kShare).value_or(pose);
}

mat4x3 unscaled(const mat4x3& scene_from_node) {
  const mat3 linear(scene_from_node);
  if (!invertible(scene_from_node)) return mat4x3(1);
  const vec3 z = glm::normalize(linear[2]);
  const vec3 x = glm::normalize(linear[0] - z * glm::dot(linear[0], z));
  const mat3 turned(x, glm::cross(z, x), z);
  const auto pose = mat4x3(glm::inverse(linear) * turned);
  const bool same = glm::all(glm::lessThan(glm::abs(linear[0] - x), vec3(1e-5f))) &&
                    glm::all(glm::lessThan(glm::abs(linear[1] - turned[1]), vec3(1e-5f))) &&
                    glm::all(glm::lessThan(glm::abs(linear[2] - z), vec3(1e-5f)));
  return same || !invertible(pose) ? mat4x3(1) : pose;
}

}  // namespace heliograph::assets
