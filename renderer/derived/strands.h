// Data computed once from the points of strands. Called by renderer/placement.
#pragma once

#include "renderer/derived/derived_cache.h"
#include "renderer/scene/components.h"

namespace heliograph::resident {

/// Points and texture coordinates of the strands of a mesh at rest, by point.
struct Strands {
  ArrayOf<vec4> points;  // as kernels::MeshView has them
  ArrayOf<vec2> uvs;     // the share of its strand's length; v is 0
  [[nodiscard]] u64 bytes() const {
    return points.size() * sizeof(vec4) + uvs.size() * sizeof(vec2);
  }
};

/// A function of the topology and the first key. Null: the mesh has no curves. Thread: any.
[[nodiscard]] std::shared_ptr<const Strands> strands_of(const MeshTopology& topology,
                                                        const VertexKeys& vertices,
                                                        DerivedCache& cache);

}  // namespace heliograph::resident
