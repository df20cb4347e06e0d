// A tree over boxes in small steps, each of which a GPU takes for all boxes at once: keys along a
// curve through space, clusters of near boxes (bvh_cluster.h), wide nodes from the root on. Called
// by renderer/backend/cuda/build.cu; the unit tests take the same steps one by one.
//
// Whoever takes which step first, the tree is the same: nodes have their numbers from where their
// items lie on the curve and from how many nodes their children need.
#pragma once

#include "kernels/bvh/bvh_meet.h"
#include "kernels/bvh/bvh_pack.h"
#include "kernels/bvh/bvh_plan.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A node of the binary tree. The first ones are the items in the order of their keys.
struct alignas(16) BuildNode {
  BvhBox box;
  u32 left, right;  // kNone: an item
  WidePlan plan;
  u32 items;
  u32 wide[kMostRoots];  // wide nodes of the subtree as at most 1, 2, .. children
  u8 depth[kMostRoots];  // and levels of them, at most 255
};

/// A subtree that waits for another to become a larger one with.
struct alignas(8) BuildCluster {
  u32 node;  // kNone: none, and none follows
  u32 home;  // the first of its items
};

/// A wide node to be made.
struct alignas(16) BuildTask {
  u32 node;         // of the binary tree; kNone: nobody has put the task here yet
  u32 number;       // of the wide node
  u32 first_child;  // what comes below it begins at these
  u32 first_item;
};

/// State that all steps share. Begins as bytes of 0xff.
struct BuildHead {
  u32 lower[3], upper[3];                // ordered_bits() of the corners of all boxes, the upper
  u32 center_lower[3], center_upper[3];  // ones with their signs turned; and of their centres
  u32 count;                             // of boxes that are not empty
  u32 root;                              // of the binary tree
  u32 balances;                          // the first tree was too deep
  u32 tasks;                             // that were put down so far, with that of the root
  u32 taken;                             // of them
};

/// Facts of a tree over instances for whoever refits it.
struct TreeHead {
  u32 items;   // in the tree; the boxes of the others are empty
  u32 nodes;   // wide ones
  float cost;  // for rays when it was built, by the area of its box
};

struct BuildView {
  u32 count;        // boxes, at most kMostBuildBoxes
  float item_cost;  // of meeting an item, against 1 of a node
  const BvhBox* boxes;
  const u64* keys;   // sorted; kNoKey: an empty box
  const u32* order;  // numbers of boxes in that order
  BuildHead* head;
  BuildNode* nodes;        // 2 * count
  BuildCluster* clusters;  // count
  u32* ends;               // 2 * count; the balanced tree's come second
  BuildTask* tasks;        // count; that of the root is root_task()
  BvhNode* wide;           // count; the root is the first: the result
  u32* items;              // count; numbers of boxes, those that are empty last: the result
  TreeHead* tree;          // null: nobody refits it
  u32* parents;            // count; of wide nodes but the root; null with `tree`
};

/// The balanced tree over so many boxes is no deeper than kBvhDepth.
inline constexpr u32 kMostBuildBoxes = 1u << kBvhDepth;
inline constexpr u64 kNoKey = ~u64(0);

// ---------------------------------------------------------------- keys

/// Integers in the order of floats.
KERNEL u32 ordered_bits(float x) {
  const u32 bits = bits_of_float(x);
  return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}
KERNEL float float_of_ordered(u32 bits) {
  return float_of_bits(bits & 0x80000000u ? bits & 0x7fffffffu : ~bits);
}
KERNEL BvhBox box_of_ordered(const u32 (&lower)[3], const u32 (&upper)[3]) {
  BvhBox box;
  for (int k = 0; k < 3; ++k) {
    box.lower[k] = float_of_ordered(lower[k]);
    box.upper[k] = -float_of_ordered(upper[k]);
  }
  return box;
}

/// Factor for areas with which those of huge boxes stay finite and those of tiny ones differ
/// from 0.
KERNEL float area_scale(const BuildHead& head) {
  const BvhBox all = box_of_ordered(head.lower, head.upper);
  const float largest = max_component(all.upper * 0.5f - all.lower * 0.5f);
  if (!(largest > 0)) return 1;
  const int exponent = -::ilogbf(largest);
  return ::ldexpf(1.0f, exponent < -126 ? -126 : exponent > 126 ? 126 : exponent);
}

/// The lower 21 bits, each with two bits of 0 after it.
KERNEL u64 spread_bits(u64 x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x001f00000000ffffull;
  x = (x | x << 16) & 0x001f0000ff0000ffull;
  x = (x | x << 8) & 0x100f00f00f00f00full;
  x = (x | x << 4) & 0x10c30c30c30c30c3ull;
  return (x | x << 2) & 0x1249249249249249ull;
}

/// Place of a box's centre on Morton's curve through the cube about all centres, in 63 bits.
KERNEL u64 morton_key(const BuildHead& head, const BvhBox& box) {
  if (box.empty()) return kNoKey;
  constexpr float kCells = 1 << 21;
  const BvhBox centers = box_of_ordered(head.center_lower, head.center_upper);
  const float extent = 2 * max_component(centers.upper * 0.5f - centers.lower * 0.5f);
  const vec3 from = box.center() - centers.lower;
  u64 key = 0;
  for (int k = 0; k < 3; ++k) {
    const float at = from[k] / extent * kCells;  // a NaN among few equal centres is cell 0
    key |= spread_bits(at > 0 ? u64(min2(at, kCells - 1)) : 0) << (2 - k);
  }
  return key;
}

// ---------------------------------------------------------------- items

/// Item i of the binary tree, before anything is made of it.
KERNEL void build_leaf(const BuildView& view, u32 i) {
  BuildHead& head = *view.head;
  const bool is_there = view.keys[i] != kNoKey;
  if (is_there && (i + 1 == view.count || view.keys[i + 1] == kNoKey)) head.count = i + 1;
  if (i == 0) {
    if (!is_there) head.count = 0;
    head.root = 0;  // of a tree of one item
    head.balances = 0;
    head.tasks = 1;
    head.taken = 0;
  }
  view.ends[i] = view.ends[u64(view.count) + i] = kNone;
  view.tasks[i].node = kNone;
  if (!is_there) {
    view.items[i] = view.order[i];
    return;
  }
  BuildNode node{};
  node.box = view.boxes[view.order[i]];
  node.left = node.right = kNone;
  node.items = 1;
  node.plan = plan_item({box_area(node.box, area_scale(head)), view.item_cost, 1});
  view.nodes[i] = node;
}

/// The node over two that are done.
///
/// Source: Ylitie, Karras and Laine 2017, section 4.1.
KERNEL BuildNode node_over(const BuildView& view, const uvec2& children, float scale) {
  const BuildNode &left = view.nodes[children.x], &right = view.nodes[children.y];
  BuildNode node;
  node.left = children.x;
  node.right = children.y;
  node.box = left.box;
  node.box.extend(right.box);
  node.items = left.items + right.items;
  node.plan =
      plan_pair(left.plan, right.plan, {box_area(node.box, scale), view.item_cost, node.items});
  u32 wide = 0, depth = 0;
  const auto count = [&](u32 roots) {
    const u32 l = node.plan.left_roots[roots - 1], r = roots - l;
    wide = left.wide[l - 1] + right.wide[r - 1];
    depth = max2(left.depth[l - 1], right.depth[r - 1]);
  };
  if (!node.plan.leaf) {
    count(kBvhChildren);
    ++wide;
    ++depth;
  }
  HELIO_UNROLL
  for (u32 roots = 1; roots <= kMostRoots; ++roots) {
    if (roots > 1 && node.plan.left_roots[roots - 1] > 0) count(roots);
    node.wide[roots - 1] = wide;
    node.depth[roots - 1] = u8(min2(depth, 255u));
  }
  return node;
}

// ---------------------------------------------------------------- wide nodes

/// The children of a wide node, from left to right.
KERNEL u32 planned_children(const BuildView& view, u32 root, BvhChild (&out)[kBvhChildren]) {
  struct Part {
    u32 node, roots;
  } parts[kBvhChildren];
  u32 count = 0, waiting = 1;
  parts[0] = {root, view.nodes[root].plan.leaf ? 1 : kBvhChildren};
  while (waiting > 0) {
    const Part part = parts[--waiting];
    const BuildNode& node = view.nodes[part.node];
    const u32 roots =
        part.roots == kBvhChildren ? kBvhChildren : planned_roots(node.plan, part.roots);
    if (roots == 1) {
      out[count++] = {node.box, part.node, node.plan.leaf ? node.items : 0};
      continue;
    }
    const u32 left = node.plan.left_roots[roots - 1];
    parts[waiting++] = {node.right, roots - left};
    parts[waiting++] = {node.left, left};
  }
  return count;
}

/// Writes the numbers of a leaf's boxes.
KERNEL void write_items(const BuildView& view, u32 leaf, u32* to) {
  u32 parts[kBvhLeafItems];
  u32 waiting = 1;
  parts[0] = leaf;
  while (waiting > 0) {
    const u32 part = parts[--waiting];
    const BuildNode& node = view.nodes[part];
    if (node.left == kNone) {
      *to++ = view.order[part];
      continue;
    }
    parts[waiting++] = node.right;
    parts[waiting++] = node.left;
  }
}

KERNEL BuildTask root_task(const BuildView& view) { return {view.head->root, 0, 1, 0}; }

/// Number of wide nodes to make. Once the binary tree is there.
KERNEL u32 wide_nodes(const BuildView& view) {
  if (view.head->count == 0) return 1;
  return max2(view.nodes[view.head->root].wide[0], 1u);  // the root may be a leaf of few items
}

/// For who refits it.
KERNEL void describe_tree(const BuildView& view) {
  *view.tree = {view.head->count, wide_nodes(view), 0};
  if (view.head->count == 0) return;
  const BuildNode& root = view.nodes[view.head->root];
  view.tree->cost = root.plan.cost[0] / box_area(root.box, area_scale(*view.head));
}

/// Makes a wide node and its leaves.
///
/// push   takes the task of each child that is a node
template <class Push>
KERNEL void build_wide(const BuildView& view, const BuildTask& task, Push&& push) {
  if (view.tree && task.number == 0) describe_tree(view);
  if (view.head->count == 0) {
    view.wide[0] = BvhNode{};  // nothing is met
    return;
  }
  BvhChild slots[kBvhChildren];
  const u32 count = planned_children(view, task.node, slots);
  const BvhBox box = view.nodes[task.node].box;
  order_children(slots, count, box);
  BvhNode node = pack_node(slots, box);
  node.first_child = task.first_child;
  node.first_item = task.first_item;
  u32 child = task.first_child, below = child + count_bits(node.inner), item = task.first_item;
  for (const BvhChild& slot : slots)
    if (slot.source != kNone && slot.items > 0) {
      write_items(view, slot.source, view.items + item);
      item += slot.items;
    }
  for (const BvhChild& slot : slots)
    if (slot.source != kNone && slot.items == 0) {
      if (view.parents) view.parents[child] = task.number;
      push(BuildTask{slot.source, child++, below, item});
      below += view.nodes[slot.source].wide[0] - 1;
      item += view.nodes[slot.source].items;
    }
  view.wide[task.number] = node;
}

static_assert(sizeof(BuildNode) == 112 && std::is_trivially_copyable_v<BuildNode>);
static_assert(std::is_trivially_copyable_v<BuildView>);

}  // namespace heliograph::kernels::inline HELIO_ISA
