#include "renderer/bvh/binary_tree.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>

#include "renderer/base/parallel.h"

namespace heliograph::bvh {
namespace {

constexpr u32 kBins = 16;
constexpr u32 kChunk = 1 << 15;  // items that one thread looks at
constexpr u32 kAlone = 1 << 12;  // at most so many are split by one thread

/// A box; the fourth lane of `lower` has its number's bits.
class Item {
 public:
  Item(const Box& box, u32 number)
      : lower{box.lower.x, box.lower.y, box.lower.z, std::bit_cast<float>(number | kNoDenormal)},
        upper{box.upper.x, box.upper.y, box.upper.z, 0} {}
  [[nodiscard]] Lanes center() const { return lower * 0.5f + upper * 0.5f; }
  [[nodiscard]] u32 number() const { return std::bit_cast<u32>(float(lower[3])) & ~kNoDenormal; }

  Lanes lower, upper;

 private:
  static constexpr u32 kNoDenormal = 1u << 30;  // arithmetic with one is slow
};

struct Bounds {
  LaneBox box, centers;
  void extend(const Item& item) {
    box.lower = least(box.lower, item.lower);
    box.upper = most(box.upper, item.upper);
    centers.extend(item.center());
  }
  void extend(const Bounds& other) {
    box.extend(other.box);
    centers.extend(other.centers);
  }
};

/// Which bin a box's centre falls into, by axis; fewer than kBins where there are few boxes.
struct Binning {
  Lanes origin, scale;
  u32 used;
  Binning(const LaneBox& centers, u32 count)
      : origin(centers.lower), used(std::clamp(count, 2u, kBins)) {
    const Lanes extent = centers.upper - centers.lower;
    for (int k = 0; k < 4; ++k) {
      const float bins = float(used) / extent[k];
      scale[k] = k < 3 && extent[k] > 0 && std::isfinite(bins) ? bins : 0;
    }
  }
  [[nodiscard]] Lanes places(Lanes center) const { return (center - origin) * scale; }
  [[nodiscard]] u32 bin(float place) const {  // NaN: 0
    return place > 0 ? std::min(used - 1, u32(std::min(place, float(kBins)))) : 0;
  }
};

/// Contents of each bin; those not in use have no values.
struct Bins {
  explicit Bins(u32 count) : used(count) {
    const LaneBox none;
    for (int k = 0; k < 3; ++k)
      for (u32 b = 0; b < used; ++b) {
        lower[k][b] = none.lower;
        upper[k][b] = none.upper;
        counts[k][b] = 0;
      }
  }
  void add(const Item& item, const Binning& binning) {
    const Lanes places = binning.places(item.center());
    for (int k = 0; k < 3; ++k) {
      const u32 b = binning.bin(places[k]);
      lower[k][b] = least(lower[k][b], item.lower);
      upper[k][b] = most(upper[k][b], item.upper);
      ++counts[k][b];
    }
  }
  void add(const Bins& other) {
    for (int k = 0; k < 3; ++k)
      for (u32 b = 0; b < used; ++b) {
        lower[k][b] = least(lower[k][b], other.lower[k][b]);
        upper[k][b] = most(upper[k][b], other.upper[k][b]);
        counts[k][b] += other.counts[k][b];
      }
  }
  [[nodiscard]] LaneBox box(int axis, u32 b) const { return {lower[axis][b], upper[axis][b]}; }

  u32 used;
  Lanes lower[3][kBins], upper[3][kBins];
  u32 counts[3][kBins];
};

struct Split {
  int axis = -1;  // -1: none
  u32 bin = 0;    // the first of the right side
  float cost = INFINITY;
};

class Builder {
 public:
  Builder(std::span<const Box> boxes, const TreeOptions& options, const Interrupt& interrupt)
      : options_(options), interrupt_(interrupt) {
    items_.reserve(boxes.size());
    for (u32 i = 0; i < boxes.size(); ++i)
      if (!boxes[i].empty()) items_.emplace_back(boxes[i], i);
  }

  Expected<BinaryTree> build() {
    const u32 count = u32(items_.size());
    if (count == 0) return BinaryTree{};
    tree_.nodes.resize(2 * std::size_t(count) - 1);
    const Bounds all = bounds();
    const Lanes half = all.box.upper * 0.5f - all.box.lower * 0.5f;
    const float largest = std::max({half[0], half[1], half[2]});
    // Areas of huge boxes stay finite, those of tiny ones differ from 0.
    if (largest > 0) scale_ = std::ldexp(1.0f, std::clamp(-std::ilogb(largest), -126, 126));
    split({.node = 0, .first = 0, .count = count, .depth = 0}, all);
    HELIO_TRY(interrupt_.status());
    tree_.items.resize(count);
    for (u32 i = 0; i < count; ++i) tree_.items[i] = items_[i].number();
    return std::move(tree_);
  }

 private:
  struct Range {
    u32 node, first, count, depth;
    [[nodiscard]] u32 end() const { return first + count; }
  };

  [[nodiscard]] Bounds bounds() const;
  [[nodiscard]] Bins bins(const Range& range, const Binning& binning) const;
  [[nodiscard]] Split best(const Bins& bins) const;
  void split(const Range& range, const Bounds& bounds);
  u32 part(const Range& range, const Bounds& bounds, Bounds (&sides)[2]);
  u32 halve(const Range& range, const Bounds& bounds, Bounds (&sides)[2]);
  void plan(u32 node);

  const TreeOptions options_;
  const Interrupt& interrupt_;
  float scale_ = 1;
  std::vector<Item> items_;
  BinaryTree tree_;
  std::atomic<bool> given_up_ = false;
};

Bounds Builder::bounds() const {
  std::vector<Bounds> chunks((items_.size() + kChunk - 1) / kChunk);
  parallel_for(chunks.size(), [&](std::size_t c) {
    Bounds mine;
    for (std::size_t i = c * kChunk; i < std::min((c + 1) * kChunk, items_.size()); ++i)
      mine.extend(items_[i]);
    chunks[c] = mine;
  });
  Bounds all;
  for (const Bounds& chunk : chunks) all.extend(chunk);
  return all;
}

/// Counts and boxes do not depend on the order in which they are added.
Bins Builder::bins(const Range& range, const Binning& binning) const {
  if (range.count <= kChunk) {
    Bins all(binning.used);
    for (u32 i = range.first; i < range.end(); ++i) all.add(items_[i], binning);
    return all;
  }
  std::vector<Bins> chunks((range.count + kChunk - 1) / kChunk, Bins(binning.used));
  parallel_for(u32(chunks.size()), [&](u32 c) {
    const u32 first = range.first + c * kChunk;
    for (u32 i = first; i < std::min(first + kChunk, range.end()); ++i)
      chunks[c].add(items_[i], binning);
  });
  for (std::size_t c = 1; c < chunks.size(); ++c) chunks[0].add(chunks[c]);
  return chunks[0];
}

Split Builder::best(const Bins& bins) const {
  Split best;
  for (int k = 0; k < 3; ++k) {
    const auto& counts = bins.counts[k];
    float right_cost[kBins];
    LaneBox box;
    u32 count = 0;
    for (u32 b = bins.used - 1; b > 0; --b) {
      box.extend(bins.box(k, b));
      count += counts[b];
      right_cost[b] = count ? box.area(scale_) * float(count) : INFINITY;
    }
    box = {};
    count = 0;
    for (u32 b = 1; b < bins.used; ++b) {
      box.extend(bins.box(k, b - 1));
      count += counts[b - 1];
      const float cost = count ? box.area(scale_) * float(count) + right_cost[b] : INFINITY;
      if (cost < best.cost) best = {.axis = k, .bin = b, .cost = cost};
    }
  }
  return best;
}

/// Sorts the range into two sides; returns where the right one begins.
u32 Builder::part(const Range& range, const Bounds& bounds, Bounds (&sides)[2]) {
  const u32 levels_left = kMostHeight - range.depth;
  const bool balances = u32(std::bit_width(range.count - 1)) >= levels_left;
  const Binning binning(bounds.centers, range.count);
  const Split split = balances ? Split{} : best(bins(range, binning));
  if (split.axis < 0) return halve(range, bounds, sides);
  const auto is_left = [&](const Item& item) {
    return binning.bin(binning.places(item.center())[split.axis]) < split.bin;
  };
  u32 left = range.first, right = range.end();
  while (true) {
    for (; left < right && is_left(items_[left]); ++left) sides[0].extend(items_[left]);
    for (; left < right && !is_left(items_[right - 1]); --right) sides[1].extend(items_[right - 1]);
    if (left == right) return left;
    std::swap(items_[left], items_[right - 1]);
  }
}

u32 Builder::halve(const Range& range, const Bounds& bounds, Bounds (&sides)[2]) {
  const Lanes extent = bounds.centers.upper - bounds.centers.lower;
  const int axis = extent[0] >= extent[1] && extent[0] >= extent[2] ? 0
                   : extent[1] >= extent[2]                         ? 1
                                                                    : 2;
  const u32 middle = range.first + range.count / 2;
  const auto begin = items_.begin();
  std::nth_element(begin + range.first, begin + middle, begin + range.end(),
                   [axis](const Item& a, const Item& b) {
                     const float x = a.center()[axis], y = b.center()[axis];
                     return x < y || (x == y && a.number() < b.number());
                   });
  for (u32 i = range.first; i < range.end(); ++i) sides[i < middle ? 0 : 1].extend(items_[i]);
  return middle;
}

void Builder::split(const Range& range, const Bounds& bounds) {
  BinaryNode& node = tree_.nodes[range.node];
  node.box = bounds.box;
  node.first = range.first;
  node.count = range.count;
  if (range.count > kAlone) {
    if (interrupt_.requested()) given_up_.store(true, std::memory_order_relaxed);
    if (given_up_.load(std::memory_order_relaxed)) return;
  }
  if (range.count > 1) {
    Bounds sides[2];
    const u32 middle = part(range, bounds, sides);
    const u32 left_count = middle - range.first;
    const Range left{range.node + 1, range.first, left_count, range.depth + 1};
    const Range right{range.node + 2 * left_count, middle, range.count - left_count,
                      range.depth + 1};
    if (range.count > kAlone) {
      parallel_invoke([&] { split(left, sides[0]); }, [&] { split(right, sides[1]); });
    } else {
      split(left, sides[0]);
      split(right, sides[1]);
    }
  }
  if (!given_up_.load(std::memory_order_relaxed)) plan(range.node);
}

/// The plan of a subtree whose children have theirs.
void Builder::plan(u32 number) {
  BinaryNode& node = tree_.nodes[number];
  const kernels::PlanCosts costs{node.box.area(scale_), options_.item_cost, node.count};
  node.height = 0;
  if (!node.splits()) {
    node.plan = kernels::plan_item(costs);
    return;
  }
  const BinaryNode& left = tree_.nodes[tree_.left(number)];
  const BinaryNode& right = tree_.nodes[tree_.right(number)];
  node.height = u8(1 + std::max(left.height, right.height));
  node.plan = kernels::plan_pair(left.plan, right.plan, costs);
}

}  // namespace

Expected<BinaryTree> build_binary(std::span<const Box> boxes, const TreeOptions& options,
                                  const Interrupt& interrupt) {
  return Builder(boxes, options, interrupt).build();
}

}  // namespace heliograph::bvh
