// A tree whose boxes have moved: the same nodes over the same items, with boxes that fit again,
// from the leaves up. Called by renderer/backend/cuda/build.cu.
#pragma once

#include "kernels/bvh/bvh_build.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Subtree after a refit.
struct alignas(16) RefitNode {
  BvhBox box;
  float cost;  // for rays, as WidePlan counts it
};

struct RefitView {
  const BvhNode* before;
  const BvhBox* boxes;  // of items, in their order in the tree
  float item_cost;
  RefitNode* nodes;  // of the tree, by their numbers
  BvhNode* wide;     // the result
};

/// Factor for areas, see area_scale(): by the size of the tree before.
KERNEL float refit_scale(const BvhNode& root) {
  const int largest =
      max2(max2(int(root.exponent[0]), int(root.exponent[1])), int(root.exponent[2]));
  const int exponent = 127 - 8 - largest;  // a node's box has up to 2^8 steps along each axis
  return ::ldexpf(1.0f, exponent < -126 ? -126 : exponent > 126 ? 126 : exponent);
}

/// A node whose children are done.
KERNEL void refit_node(const RefitView& view, u32 number, float scale) {
  const BvhNode before = view.before[number];
  BvhChild slots[kBvhChildren];
  RefitNode own{no_box(), 0};
  HELIO_UNROLL
  for (u32 s = 0; s < kBvhChildren; ++s) {
    BvhChild& slot = slots[s];
    slot = {no_box(), kNone, 0};
    const u32 meta = before.meta[s];
    if (meta == 0) continue;
    if (before.inner >> s & 1) {
      slot.source = before.first_child + count_bits(before.inner & ((1u << s) - 1));
      slot.box = view.nodes[slot.source].box;
      own.cost += view.nodes[slot.source].cost;
    } else {
      slot.source = before.first_item + (meta & 0x1f);
      slot.items = count_bits(meta >> 5);
      for (u32 i = 0; i < slot.items; ++i) slot.box.extend(view.boxes[slot.source + i]);
      own.cost += leaf_cost({box_area(slot.box, scale), view.item_cost, slot.items});
    }
    own.box.extend(slot.box);
  }
  own.cost += box_area(own.box, scale);
  BvhNode node = pack_node(slots, own.box);
  node.first_child = before.first_child;
  node.first_item = before.first_item;
  view.wide[number] = node;
  view.nodes[number] = own;
}

/// True if a refitted tree is nearly as good as when it was built.
///
/// cost   then, by the area of its box
KERNEL bool is_good(const RefitNode& root, float cost, float scale) {
  constexpr float kWorse = 1.1f;
  return root.cost <= kWorse * cost * box_area(root.box, scale);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
