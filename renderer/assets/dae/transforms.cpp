#include "renderer/assets/dae/transforms.h"

#include <cmath>
#include <glm/gtc/matrix_transform.hpp>

namespace heliograph::assets::dae {

u32 transform_width(const Node& element) {
  const std::string_view tag = element.name();
  if (tag == "lookat" || tag == "skew")
    refuse_unimplemented(place(element), fmt::format("<{}>; export matrices", tag));
  if (tag == "matrix") return 16;
  if (tag == "rotate") return 4;
  return tag == "translate" || tag == "scale" ? 3 : 0;
}

void check_finite(const mat4x3& pose, const Node& node) {
  for (int column = 0; column < 4; ++column)
    if (!std::isfinite(glm::dot(pose[column], vec3(1))))
      refuse(place(node), "its transforms reach beyond what f32 can hold");
}

mat4x3 matrix_of(std::span<const float> m, const Node& element) {
  constexpr float kRounding = 1e-5f;
  const vec4 off(m[12], m[13], m[14], m[15] - 1);
  if (glm::any(glm::greaterThan(glm::abs(off), vec4(kRounding))))
    refuse(place(element), "the last row of a matrix must be 0 0 0 1");
  return mat4x3(m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10], m[3], m[7], m[11]);
}

mat4x3 transform_with(const Node& element, std::span<const float> numbers) {
  const std::string_view tag = element.name();
  if (tag == "matrix") return matrix_of(numbers, element);
  const vec3 v(numbers[0], numbers[1], numbers[2]);
  if (tag == "translate") return mat4x3(glm::translate(mat4(1), v));
  if (tag == "scale") return mat4x3(glm::scale(mat4(1), v));
  const glm::dvec3 axis(v);
  if (glm::length(axis) == 0) return mat4x3(1);
  return mat4x3(mat4(glm::rotate(glm::dmat4(1), glm::radians(double(numbers[3])), axis)));
}

std::optional<mat4x3> transform_of(const Node& element, Budget& budget) {
  const u32 width = transform_width(element);
  if (width == 0) return std::nullopt;
  return transform_with(element, read_floats(element, width, budget));
}

}  // namespace heliograph::assets::dae
