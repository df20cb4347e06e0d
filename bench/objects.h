// Common part of the benches of edits and scenes on the host.
#pragma once

#include <chrono>

#include "renderer/scene/scene.h"

namespace heliograph::bench {

/// Milliseconds of a clock that never goes back.
inline double milliseconds() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double, std::milli>(now).count();
}

inline PutMesh tetrahedron() {
  MeshTopology topology{.vertex_count = 4};
  topology.triangles =
      ArrayOf<uvec3>(std::vector<uvec3>{{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}});
  VertexKeys keys{.times = {0}, .positions = {}, .normals = {}};
  keys.positions = ArrayOf(std::vector<vec3>{{0, 0, 0}, {0.4f, 0, 0}, {0, 0.4f, 0}, {0, 0, 0.4f}});
  return {.topology = std::make_shared<const MeshTopology>(std::move(topology)),
          .vertices = std::make_shared<const VertexKeys>(std::move(keys))};
}

}  // namespace heliograph::bench
