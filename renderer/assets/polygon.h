// Polygons of a file as triangles. Used by OBJ, PLY and COLLADA.
#pragma once

#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph::assets {

/// Cuts a polygon of any size into triangles in its own plane, by ear clipping. Holes are those
/// that a bridge joins to the outline: an edge there and back, over corners in the same places.
/// `triangles` becomes its polygon.size() - 2 triangles, of indices into it.
/// Source: Meisters 1975, "Polygons Have Ears".
void triangulate(std::span<const glm::dvec3> polygon, std::vector<uvec3>& triangles);

/// The polygon's normal, of length twice its area. Source: Newell's method.
[[nodiscard]] glm::dvec3 normal_of(std::span<const glm::dvec3> polygon);

}  // namespace heliograph::assets
