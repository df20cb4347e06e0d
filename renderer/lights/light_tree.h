// Builds light trees from bounds. Called by lights.cpp and part_trees.cpp.
#pragma once

#include <span>
#include <vector>

#include "kernels/light/light_tree.h"

namespace heliograph::resident {

/// Nodes with the root first, and the order of the elements in their leaves: a leaf's entries are
/// order[first .. first + count).
struct LightTree {
  std::vector<kernels::LightNode> nodes;
  std::vector<kernels::u32> order;
  kernels::LightBounds bounds;  // of the root
};

/// A function of its arguments alone, whatever the threads. leaf_size: the most elements of a leaf.
[[nodiscard]] LightTree build_light_tree(std::span<const kernels::LightBounds> elements,
                                         kernels::u32 leaf_size);

}  // namespace heliograph::resident
