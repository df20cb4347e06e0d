// Transformations of a <node>. Source: COLLADA 1.5.0, chapter 5.
#pragma once

#include <optional>
#include <span>

#include "renderer/assets/dae/document.h"

namespace heliograph::assets::dae {

/// Count of numbers of an element if it is a transformation; 0: it is none. Refuses those that are
/// not read.
[[nodiscard]] u32 transform_width(const Node& element);
/// parent_from_child of a transformation with these numbers in the place of its own.
[[nodiscard]] mat4x3 transform_with(const Node& element, std::span<const float> numbers);
/// parent_from_child; nullopt: the element is no transformation.
[[nodiscard]] std::optional<mat4x3> transform_of(const Node& element, Budget& budget);
/// Refuses a pose with a number that is not.
void check_finite(const mat4x3& pose, const Node& node);
/// Matrix of the 16 numbers of a <matrix> or a part of a skin, by rows.
[[nodiscard]] mat4x3 matrix_of(std::span<const float> numbers, const Node& element);

}  // namespace heliograph::assets::dae
