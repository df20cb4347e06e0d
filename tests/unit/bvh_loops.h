// The steps of kernels/bvh/bvh_build.h one after the other: the tree that a GPU makes of the same
// boxes.
#pragma once

#include <algorithm>
#include <deque>
#include <numeric>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "kernels/bvh/bvh_cluster.h"
#include "renderer/base/types.h"

namespace heliograph::test {

/// Which of the things that a GPU does at once come first.
enum class LoopOrder { kForwards, kBackwards, kShuffled };

/// Owns: what a build works on and what it makes.
class LoopBuild {
 public:
  LoopBuild(std::span<const kernels::BvhBox> boxes, float item_cost, LoopOrder order)
      : boxes_(boxes) {
    const u32 count = u32(boxes.size());
    std::memset(&head_, 0xff, sizeof(head_));
    nodes_.resize(2 * count);
    clusters_.resize(count);
    ends_.resize(2 * count);
    tasks_.resize(count);
    wide_.resize(count);
    items_.assign(count, kernels::kNone);
    sort();
    view_ = {.count = count,
             .item_cost = item_cost,
             .boxes = boxes.data(),
             .keys = keys_.data(),
             .order = order_.data(),
             .head = &head_,
             .nodes = nodes_.data(),
             .clusters = clusters_.data(),
             .ends = ends_.data(),
             .tasks = tasks_.data(),
             .wide = wide_.data(),
             .items = items_.data()};
    for (u32 i = 0; i < count; ++i) kernels::build_leaf(view_, i);
    for (const u32 i : in_order(head_.count, order)) climb(i);
    if (head_.balances != 0)
      for (const u32 i : in_order(head_.count, order)) climb(i);
    make_wide(order);
    wide_.resize(kernels::wide_nodes(view_));
  }

  LoopBuild(const LoopBuild&) = delete;
  LoopBuild& operator=(const LoopBuild&) = delete;

  [[nodiscard]] const std::vector<kernels::BvhNode>& nodes() const { return wide_; }
  [[nodiscard]] const std::vector<u32>& items() const { return items_; }
  [[nodiscard]] const kernels::BuildHead& head() const { return head_; }

 private:
  static std::vector<u32> in_order(u32 count, LoopOrder order) {
    std::vector<u32> all(count);
    std::iota(all.begin(), all.end(), 0u);
    if (order == LoopOrder::kBackwards) std::ranges::reverse(all);
    if (order == LoopOrder::kShuffled) std::ranges::shuffle(all, std::mt19937(1));
    return all;
  }

  void sort() {
    const auto note = [](u32(&lower)[3], u32(&upper)[3], vec3 from, vec3 to) {
      for (int k = 0; k < 3; ++k) {
        lower[k] = std::min(lower[k], kernels::ordered_bits(from[k]));
        upper[k] = std::min(upper[k], kernels::ordered_bits(-to[k]));
      }
    };
    for (const kernels::BvhBox& box : boxes_) {
      if (box.empty()) continue;
      note(head_.lower, head_.upper, box.lower, box.upper);
      note(head_.center_lower, head_.center_upper, box.center(), box.center());
    }
    order_.resize(boxes_.size());
    std::iota(order_.begin(), order_.end(), 0u);
    std::vector<u64> keys;
    for (const kernels::BvhBox& box : boxes_) keys.push_back(kernels::morton_key(head_, box));
    std::ranges::stable_sort(order_, {}, [&](u32 i) { return keys[i]; });
    for (const u32 i : order_) keys_.push_back(keys[i]);
  }

  /// What the last thread to come to a node does there.
  void climb(u32 leaf) {
    kernels::BuildRange range{leaf, leaf, leaf};
    while (range.size() < head_.count) {
      bool is_left = false;
      const u32 place = kernels::parent_place(view_, range, is_left);
      const u32 other =
          std::exchange(*kernels::end_at(view_, place), is_left ? range.first : range.last);
      if (other == kernels::kNone) return;
      range = kernels::parent_range(range, is_left, other);
      if (kernels::is_joined(view_, range)) join(range);
    }
  }

  void join(const kernels::BuildRange& range) {
    const float scale = kernels::area_scale(head_);
    kernels::ClusterWindow window;
    window.count = 0;
    for (const bool left : {true, false})
      for (u32 k = 0; k < kernels::kWindow / 2; ++k) {
        const auto cluster = kernels::child_cluster(view_, range, left, k);
        if (cluster.node == kernels::kNone) break;
        kernels::put_cluster(view_, window, window.count++, cluster);
      }
    while (window.count > kernels::most_left(view_, range.size())) {
      for (u32 i = 0; i < window.count; ++i) kernels::find_nearest(window, i, scale);
      std::vector<kernels::BuildCluster> left;
      for (u32 i = 0; i < window.count; ++i) {
        const auto cluster = kernels::join_cluster(view_, window, i, scale);
        if (cluster.node != kernels::kNone) left.push_back(cluster);
      }
      window.count = u32(left.size());
      for (u32 i = 0; i < window.count; ++i) kernels::put_cluster(view_, window, i, left[i]);
    }
    for (u32 k = 0; k < kernels::kWindow; ++k) kernels::leave_cluster(view_, range, window, k);
  }

  void make_wide(LoopOrder order) {
    std::deque<kernels::BuildTask> waiting{kernels::root_task(view_)};
    std::mt19937 engine(1);
    while (!waiting.empty()) {
      if (order == LoopOrder::kShuffled)
        std::swap(waiting[engine() % waiting.size()], waiting.back());
      if (order == LoopOrder::kForwards) std::swap(waiting.front(), waiting.back());
      const kernels::BuildTask task = waiting.back();
      waiting.pop_back();
      kernels::build_wide(view_, task,
                          [&](const kernels::BuildTask& next) { waiting.push_back(next); });
    }
  }

  std::span<const kernels::BvhBox> boxes_;
  kernels::BuildHead head_;
  std::vector<u64> keys_;
  std::vector<u32> order_, ends_, items_;
  std::vector<kernels::BuildNode> nodes_;
  std::vector<kernels::BuildCluster> clusters_;
  std::vector<kernels::BuildTask> tasks_;
  std::vector<kernels::BvhNode> wide_;
  kernels::BuildView view_{};
};

}  // namespace heliograph::test
