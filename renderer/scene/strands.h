// Strands of curves: what is computed once from their points. Called by server/convert.
#pragma once

#include <span>

#include "renderer/base/error.h"
#include "renderer/scene/components.h"

namespace heliograph {

/// Sets the segments of a topology from its `curves`, whose numbers sum to vertex_count and are 2
/// at least, its strand_points, and its uvs where it has none: u is the share of a strand's length.
///
/// positions   vertex_count, metres, mesh coordinates
/// radii       as many, metres
void set_strands(MeshTopology& topology, std::span<const vec3> positions,
                 std::span<const float> radii);

/// How far the unit sphere reaches along each axis under a linear map.
[[nodiscard]] vec3 sphere_reach(const mat3& map);

}  // namespace heliograph
