// Light trees over the triangles of mesh parts. Called by lights.cpp.
#pragma once

#include "renderer/lights/light_tree.h"
#include "renderer/placement/mesh.h"

namespace heliograph::resident {

/// A texture that a mesh's emission varies with.
struct EmissionMap {
  const Texture* texture = nullptr;  // null: none, every triangle has the radiosity 1
  TextureUse use;
};

/// The trees of a mesh's parts, in object space. The radiosity of a triangle is the mean luminance
/// of its emission map over it, and never next to nothing: the mean is of some points.
struct PartTrees {
  std::vector<kernels::LightNode> nodes;  // of all parts
  std::vector<kernels::TriangleEntry> entries;
  std::vector<u32> entry_of_triangle;
  std::vector<u32> roots;                    // by part
  std::vector<u32> offsets;                  // part_count + 1: the parts' entries
  std::vector<kernels::LightBounds> bounds;  // by part; power: area times radiosity
  [[nodiscard]] kernels::TriangleTree view(u32 part) const {
    return {nodes.data(), entries.data(), entry_of_triangle.data(), roots[part]};
  }
  [[nodiscard]] u64 bytes() const {
    return nodes.size() * sizeof(nodes[0]) + entries.size() * (sizeof(entries[0]) + sizeof(u32));
  }
};
[[nodiscard]] std::shared_ptr<const PartTrees> part_trees(const DeviceMesh& mesh,
                                                          const EmissionMap& map,
                                                          DerivedCache& cache);

}  // namespace heliograph::resident
