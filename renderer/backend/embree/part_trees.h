// Light trees over the triangles of mesh parts. Called by lights.cpp.
#pragma once

#include "renderer/backend/embree/light_tree.h"
#include "renderer/backend/embree/mesh.h"

namespace heliograph::embree {

/// The trees of a mesh's parts, in object space; every triangle has the radiosity 1.
struct PartTrees {
  std::vector<kernels::LightNode> nodes;  // of all parts
  std::vector<kernels::TriangleEntry> entries;
  std::vector<u32> entry_of_triangle;
  std::vector<u32> roots;                    // by part
  std::vector<u32> offsets;                  // part_count + 1: the parts' entries
  std::vector<kernels::LightBounds> bounds;  // by part; power: the area
  [[nodiscard]] kernels::TriangleTree view(u32 part) const {
    return {nodes.data(), entries.data(), entry_of_triangle.data(), roots[part]};
  }
  [[nodiscard]] u64 bytes() const {
    return nodes.size() * sizeof(nodes[0]) + entries.size() * (sizeof(entries[0]) + sizeof(u32));
  }
};
[[nodiscard]] std::shared_ptr<const PartTrees> part_trees(const DeviceMesh& mesh,
                                                          DerivedCache& cache);

}  // namespace heliograph::embree
