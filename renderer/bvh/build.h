// Trees of the kernels' BVH over boxes. Called by accelerator.cpp.
#pragma once

#include <span>
#include <vector>

#include "kernels/bvh/bvh.h"
#include "renderer/base/box.h"
#include "renderer/device/backend.h"

namespace heliograph::bvh {

using resident::Box;

/// A tree whose leaves' items are numbers of `items`.
struct Tree {
  std::vector<kernels::BvhNode> nodes;  // the root is the first; never empty
  std::vector<u32> items;               // numbers of boxes; of those that are not empty
};

struct TreeOptions {
  float item_cost = 0.3f;  // of meeting an item, against 1 of a node
};

/// Splits by the surface area heuristic. The tree is a function of the boxes alone, whatever the
/// threads, and no deeper than kernels::kBvhDepth. Boxes are finite. Fails as the interrupt does.
///
/// Source: Wald 2007, "On Fast Construction of SAH-Based Bounding Volume Hierarchies", sections 3
/// and 4; Ylitie, Karras and Laine 2017, sections 3 and 4.
[[nodiscard]] Expected<Tree> build_tree(std::span<const Box> boxes, const TreeOptions& options,
                                        const Interrupt& interrupt);

}  // namespace heliograph::bvh
