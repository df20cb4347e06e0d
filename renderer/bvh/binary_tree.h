// A binary tree over boxes, and how it is best made 8-wide. Called by build.cpp.
#pragma once

#include <span>
#include <vector>

#include "kernels/bvh/bvh_box.h"
#include "kernels/bvh/bvh_plan.h"
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
  [[nodiscard]] kernels::BvhBox box() const {
    return {{lower[0], lower[1], lower[2]}, {upper[0], upper[1], upper[2]}};
  }
};

/// Over `count` items. The left child follows; 2 * (items of the left child) further is the right
/// one.
struct BinaryNode {
  LaneBox box;
  u32 first;  // of its items
  u32 count;
  kernels::WidePlan plan;
  u8 height;  // 0: one item

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

/// Fails as the interrupt does.
[[nodiscard]] Expected<BinaryTree> build_binary(std::span<const Box> boxes,
                                                const TreeOptions& options,
                                                const Interrupt& interrupt);

}  // namespace heliograph::bvh
