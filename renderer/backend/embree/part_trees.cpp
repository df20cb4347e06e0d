// Derived data of emitting meshes.
#include "renderer/backend/embree/part_trees.h"

namespace heliograph::embree {
namespace {

using kernels::LightBounds;
using kernels::LightNode;

/// Appends the tree of one part, whose triangles are given.
void add_part(PartTrees& trees, const DeviceMesh& mesh, std::span<const u32> triangles) {
  std::vector<LightBounds> elements;
  elements.reserve(triangles.size());
  for (const u32 i : triangles) {
    const uvec3 t = mesh.topology->triangles[i];
    elements.push_back(
        kernels::triangle_bounds(mesh.positions[t.x], mesh.positions[t.y], mesh.positions[t.z]));
  }
  const u32 first_node = u32(trees.nodes.size()), first_entry = u32(trees.entries.size());
  trees.roots.push_back(first_node);
  trees.offsets.push_back(first_entry + u32(triangles.size()));
  LightBounds all;
  if (!elements.empty()) {
    const LightTree tree = build_light_tree(elements, kernels::kLeafTriangles);
    trees.nodes.insert(trees.nodes.end(), tree.nodes.begin(), tree.nodes.end());
    for (const u32 i : tree.order) {
      trees.entry_of_triangle[triangles[i]] = u32(trees.entries.size());
      trees.entries.push_back({triangles[i], 1, elements[i].power, 0});
    }
    for (u32 n = first_node; n < trees.nodes.size(); ++n) {
      LightNode& node = trees.nodes[n];
      if (node.parent != kernels::kNone) node.parent += first_node;
      node.first += node.count > 0 ? first_entry : first_node;
      for (u32 k = 0; k < node.count; ++k) trees.entries[node.first + k].leaf = n;
    }
    all = tree.bounds;
  }
  trees.bounds.push_back(all);
}

}  // namespace

std::shared_ptr<const PartTrees> part_trees(const DeviceMesh& mesh, DerivedCache& cache) {
  const MeshTopology& topology = *mesh.topology;
  const DerivedKey key{
      Derived::kParts,
      {mesh.positions.serial(), topology.triangles.serial(), topology.parts.serial()}};
  Sources sources{mesh.positions.buffer(), topology.triangles.buffer()};
  if (!topology.parts.empty()) sources.push_back(topology.parts.buffer());
  return cache.get<PartTrees>(key, std::move(sources), [&] {
    auto trees = std::make_shared<PartTrees>();
    std::vector<std::vector<u32>> parts(topology.part_count);
    for (u32 i = 0; i < topology.triangles.size(); ++i)
      parts[topology.parts.empty() ? 0 : topology.parts[i]].push_back(i);
    trees->entry_of_triangle.resize(topology.triangles.size());
    trees->offsets.push_back(0);
    for (const auto& triangles : parts) add_part(*trees, mesh, triangles);
    return trees;
  });
}

}  // namespace heliograph::embree
