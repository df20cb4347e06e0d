// A binary tree over boxes, and how it is best made 8-wide. Called by build.cpp.
#pragma once

#include <span>
#include <vector>

#include "kernels/bvh.h"
#include "renderer/bvh/build.h"

namespace heliograph::bvh {

using Lanes [[gnu::vector_size(16)]] = float;

[[nodiscard]] inline Lanes least(Lanes a, Lanes b) { return a < b ? a : b; }
[[nodiscard]] inline Lanes most(Lanes a, Lanes b) { return a > b ? a : b; }

/// A box whose fourth lane means nothing.
struct LaneBox {
  Lanes lower{INFINITY, INFINITY, INFINITY, INFINITY};
  Lanes upper{-INFINITY, -INFINITY, -INFINITY, -INFINITY};
  void extend(Lanes p) {
    lower = least(lower, p);
    upper = most(upper, p);
  }
  void extend(const LaneBox& box) {
    lower = least(lower, box.lower);
    upper = most(upper, box.upper);
  }
  /// Half the surface area of the box scaled by `scale`.
  [[nodiscard]] float area(float scale) const {
    const Lanes d = upper * scale - lower * scale;
    return d[0] * d[1] + d[1] * d[2] + d[2] * d[0];
  }
};

/// The most children that a node of the binary tree stands for among those of a wide node.
inline constexpr u32 kMostRoots = kernels::kBvhChildren - 1;

/// Over `count` items. The left child follows; 2 * (items of the left child) further is the right
/// one.
struct BinaryNode {
  LaneBox box;
  u32 first;  // of its items
  u32 count;
  float cost[kMostRoots];         // of the subtree as at most 1, 2, .. children of a wide node
  u8 left_roots[kMostRoots + 1];  // how many of 2, 3, .. 8 children its left child stands for;
                                  // [0]: unused
  bool leaf;                      // as one child it is a leaf, not a wide node
  u8 height;                      // 0: one item

  [[nodiscard]] bool splits() const { return count > 1; }
};

struct BinaryTree {
  std::vector<BinaryNode> nodes;  // the root is the first; empty: there are no items
  std::vector<u32> items;
  [[nodiscard]] u32 left(u32 node) const { return node + 1; }
  [[nodiscard]] u32 right(u32 node) const { return node + 2 * nodes[node + 1].count; }
};

/// No binary tree is higher.
inline constexpr u32 kMostHeight = 48;

/// Fails as the interrupt says.
[[nodiscard]] Expected<BinaryTree> build_binary(std::span<const Box> boxes,
                                                const TreeOptions& options,
                                                const Interrupt& interrupt);

}  // namespace heliograph::bvh
