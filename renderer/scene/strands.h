// Strands of curves: their segments, and how far they reach. Called by server/convert and by
// renderer/placement.
#pragma once

#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph {

/// The segments of strands whose points follow each other, as kernels::MeshView has them.
///
/// curves   points of each, 2 at least
[[nodiscard]] inline std::vector<uvec3> segments_of(std::span<const u32> curves) {
  std::vector<uvec3> segments;
  u32 first = 0;
  for (const u32 count : curves) {
    for (u32 i = first; i + 1 < first + count; ++i) segments.emplace_back(i, i + 1, i);
    first += count;
  }
  return segments;
}

/// Reach of the unit sphere along each axis under a linear map.
[[nodiscard]] inline vec3 sphere_reach(const mat3& map) {
  return glm::sqrt(map[0] * map[0] + map[1] * map[1] + map[2] * map[2]);
}

}  // namespace heliograph
