// How a binary tree is best made 8-wide. Called by builders of trees, bottom-up.
#pragma once

#include "kernels/bvh/bvh.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// The most children that a node of the binary tree stands for among those of a wide node.
inline constexpr u32 kMostRoots = kBvhChildren - 1;

/// The cheapest ways to make a subtree the children of wide nodes.
struct WidePlan {
  float cost[kMostRoots];         // of the subtree as at most 1, 2, .. children
  u8 left_roots[kMostRoots + 1];  // how many of 2, 3, .. 8 children its left child stands for;
                                  // 0: it stands for one fewer. [0]: unused
  bool leaf;                      // as one child it is a leaf, not a wide node
};

/// Costs of a subtree to rays, besides its children's.
struct PlanCosts {
  float area;       // half the surface area of its box
  float item_cost;  // of meeting an item, against 1 of a node
  u32 items;
};
KERNEL float leaf_cost(const PlanCosts& costs) {
  return costs.items <= kBvhLeafItems ? costs.area * float(costs.items) * costs.item_cost
                                      : INFINITY;
}

/// Plan of one item.
KERNEL WidePlan plan_item(const PlanCosts& costs) {
  WidePlan plan{};
  for (float& cost : plan.cost) cost = leaf_cost(costs);
  plan.leaf = true;
  return plan;
}

/// Plan of two subtrees that have theirs.
///
/// Source: Ylitie, Karras and Laine 2017, section 4.1.
KERNEL WidePlan plan_pair(const WidePlan& left, const WidePlan& right, const PlanCosts& costs) {
  WidePlan plan;
  plan.left_roots[0] = 0;
  float distributed[kMostRoots + 2];
  HELIO_UNROLL
  for (u32 roots = 2; roots <= kMostRoots + 1; ++roots) {
    distributed[roots] = INFINITY;
    plan.left_roots[roots - 1] = 1;
    HELIO_UNROLL
    for (u32 l = 1; l < roots; ++l) {
      const float cost = left.cost[l - 1] + right.cost[roots - l - 1];
      if (!(cost < distributed[roots])) continue;
      distributed[roots] = cost;
      plan.left_roots[roots - 1] = u8(l);
    }
  }
  const float inner_cost = distributed[kMostRoots + 1] + costs.area;
  plan.leaf = leaf_cost(costs) <= inner_cost;
  plan.cost[0] = plan.leaf ? leaf_cost(costs) : inner_cost;
  HELIO_UNROLL
  for (u32 roots = 2; roots <= kMostRoots; ++roots) {
    if (!(distributed[roots] <= plan.cost[roots - 2])) plan.left_roots[roots - 1] = 0;
    plan.cost[roots - 1] =
        distributed[roots] < plan.cost[roots - 2] ? distributed[roots] : plan.cost[roots - 2];
  }
  return plan;
}

/// Best number of children for a subtree, of at most `roots`.
KERNEL u32 planned_roots(const WidePlan& plan, u32 roots) {
  while (roots > 1 && plan.left_roots[roots - 1] == 0) --roots;
  return roots;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
