// Near boxes to pairs, pairs of pairs and so on: the binary tree of bvh_build.h. Subtrees of the
// radix tree over the keys are joined bottom-up, in windows of as many clusters as a warp has
// threads.
//
// Source: Benthin, Meister, Barczak, Mehalwal, Tsakok and Kensler 2024, "H-PLOC: Hierarchical
// Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy Construction", PACMCGIT 7(3);
// Apetrei 2014, "Fast and Simple Agglomerative LBVH Construction", CGVC.
#pragma once

#include "kernels/bvh/bvh_build.h"

namespace heliograph::kernels::inline HELIO_ISA {

inline constexpr u32 kWindow = 32;

/// Items that a node of the radix tree is over, and where its right child begins.
struct BuildRange {
  u32 first, last;
  u32 split;
  [[nodiscard]] KERNEL u32 size() const { return last - first + 1; }
};

/// True if, of two places in the order, the keys after `a` part later than those after `b`. Equal
/// keys part as their numbers do.
KERNEL bool parts_later(const BuildView& view, u32 a, u32 b) {
  if (view.head->balances == 0) {
    const u64 after_a = view.keys[a] ^ view.keys[a + 1];
    const u64 after_b = view.keys[b] ^ view.keys[b + 1];
    if (after_a != after_b) return after_a < after_b;
  }
  return (a ^ (a + 1)) < (b ^ (b + 1));
}

/// Where both children of a node's parent leave word for each other. A node that is not the root.
KERNEL u32 parent_place(const BuildView& view, const BuildRange& range, bool& is_left) {
  is_left = range.first == 0 ||
            (range.last + 1 < view.head->count && parts_later(view, range.last, range.first - 1));
  return is_left ? range.last : range.first - 1;
}
/// Place in BuildView::ends of that.
KERNEL u32* end_at(const BuildView& view, u32 place) {
  return view.ends + (view.head->balances != 0 ? u64(view.count) : 0) + place;
}
/// The parent of a node whose sibling's other end is known.
KERNEL BuildRange parent_range(const BuildRange& range, bool is_left, u32 other_end) {
  if (is_left) return {range.first, other_end, range.last + 1};
  return {other_end, range.last, range.first};
}

/// At most how many clusters a subtree leaves to its parent.
KERNEL u32 most_left(const BuildView& view, u32 items) {
  return view.head->balances != 0 || items == view.head->count ? 1 : kWindow / 2;
}
/// True if a range is joined before its parent; if not, its clusters are its items.
KERNEL bool is_joined(const BuildView& view, const BuildRange& range) {
  return range.size() > most_left(view, range.size());
}

/// Clusters side by side.
struct ClusterWindow {
  vec3 lower[kWindow], upper[kWindow];
  BuildCluster cluster[kWindow];
  u32 nearest[kWindow];
  u32 count;
};

/// The k-th cluster from where one of a range's children begins; none: node is kNone.
KERNEL BuildCluster child_cluster(const BuildView& view, const BuildRange& range, bool left,
                                  u32 k) {
  const u32 begin = left ? range.first : range.split;
  const u32 items = (left ? range.split : range.last + 1) - begin;
  if (k >= items || k >= kWindow / 2) return {kNone, kNone};
  if (items <= most_left(view, items)) return {begin + k, begin + k};
  return view.clusters[begin + k];
}
KERNEL void put_cluster(const BuildView& view, ClusterWindow& window, u32 at,
                        const BuildCluster& cluster) {
  window.cluster[at] = cluster;
  window.lower[at] = view.nodes[cluster.node].box.lower;
  window.upper[at] = view.nodes[cluster.node].box.upper;
}

/// Finds the cluster with which the i-th makes the smallest box. Of equal pairs everybody prefers
/// those whose places differ in the lowest bits: some two always agree, and of many equals all do.
KERNEL void find_nearest(ClusterWindow& window, u32 i, float scale) {
  const BvhBox own{window.lower[i], window.upper[i]};
  float best = INFINITY;
  u32 nearest = kNone;
  for (u32 bits = 1; bits < kWindow; ++bits) {
    const u32 j = i ^ bits;
    if (j >= window.count) continue;
    BvhBox both = own;
    both.extend(BvhBox{window.lower[j], window.upper[j]});
    const float area = box_area(both, scale);
    if (nearest != kNone && !(area < best)) continue;
    best = area;
    nearest = j;
  }
  window.nearest[i] = nearest;
}
KERNEL bool joins(const ClusterWindow& window, u32 i) {
  return window.nearest[window.nearest[i]] == i;
}

/// Joins cluster i of a window: it stays, or becomes one with a later one; with an earlier one it
/// is gone (kNone). Of each two that join the later one's home is no longer in use: it gives the
/// new node its number.
KERNEL BuildCluster join_cluster(const BuildView& view, const ClusterWindow& window, u32 i,
                                 float scale) {
  BuildCluster own = window.cluster[i];
  if (!joins(window, i)) return own;
  const u32 other = window.nearest[i];
  if (other < i) return {kNone, kNone};
  const BuildCluster joined = window.cluster[other];
  const u32 number = view.head->count + joined.home - 1;
  view.nodes[number] = node_over(view, {own.node, joined.node}, scale);
  own.node = number;
  return own;
}

/// Leaves what a range's window holds to its parent, by place k of the window. Where rays' stacks
/// do not suffice for the whole tree, one over the same items, halved again and again, takes its
/// place: all ranges are joined once more.
KERNEL void leave_cluster(const BuildView& view, const BuildRange& range,
                          const ClusterWindow& window, u32 k) {
  if (k < window.count)
    view.clusters[range.first + k] = window.cluster[k];
  else if (k < kWindow / 2 && k < range.size())
    view.clusters[range.first + k] = {kNone, kNone};
  if (k != 0 || range.size() != view.head->count) return;
  view.head->root = window.cluster[0].node;
  if (view.nodes[view.head->root].depth[0] > kBvhDepth) view.head->balances = 1;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
