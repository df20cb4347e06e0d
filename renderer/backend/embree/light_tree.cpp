// Light trees, top down by the surface area orientation heuristic over bins; many lights at first
// by halves of their extent, which is quicker.
#include "renderer/backend/embree/light_tree.h"

#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <array>

namespace heliograph::embree {
namespace {

using kernels::LightBounds;
using kernels::LightNode;
using kernels::u32;
using kernels::vec3;

constexpr u32 kBins = 12;
constexpr u32 kFew = 6;         // as many are halved
constexpr u32 kMany = 1024;     // more are parted in the middle of their extent
constexpr u32 kParallel = 512;  // elements of a subtree that is worth a task

vec3 center_of(const LightBounds& b) { return 0.5f * (b.lower + b.upper); }

float half_area(vec3 size) { return size.x * size.y + size.y * size.z + size.z * size.x; }

/// Cheap sums over a group of elements, for the choice of splits.
struct Group {
  vec3 lower{INFINITY};
  vec3 upper{-INFINITY};
  vec3 axes{0};
  float power = 0;
  u32 count = 0;
  void add(const LightBounds& b) {
    lower = glm::min(lower, b.lower);
    upper = glm::max(upper, b.upper);
    if (b.cos_spread > -1 && !b.two_sided) axes += b.axis * (0.5f + 0.5f * b.cos_spread);
    power += b.power;
    ++count;
  }
  void add(const Group& g) {
    lower = glm::min(lower, g.lower);
    upper = glm::max(upper, g.upper);
    axes += g.axes;
    power += g.power;
    count += g.count;
  }
  /// Power times extent times spread of directions. After Conty Estevez and Kulla 2018, section
  /// 4.4; the spread is that of the mean axis instead of the bounding cone's.
  [[nodiscard]] float cost(float smallest) const {
    if (count == 0) return 0;
    const vec3 size = glm::max(upper - lower, vec3(smallest));
    return power * half_area(size) * (1.5f - glm::length(axes) / float(count));
  }
};

class TreeBuilder {
 public:
  TreeBuilder(std::span<const LightBounds> elements, u32 leaf_size) : leaf_size_(leaf_size) {
    items_.reserve(elements.size());
    for (const LightBounds& b : elements) items_.push_back({b, center_of(b), u32(items_.size())});
    tree_.nodes.resize(2 * elements.size() - 1);
  }

  LightTree build() {
    tree_.bounds = build({0, kernels::kNone, 1, 0, u32(items_.size())});
    for (const Item& item : items_) tree_.order.push_back(item.element);
    if (leaf_size_ > 1) compact();
    return std::move(tree_);
  }

 private:
  struct Item {
    LightBounds bounds;
    vec3 center;
    u32 element;
  };
  /// Items [begin, end) make `node`; what is beneath it lies at `free` and after.
  struct Task {
    u32 node, parent, free, begin, end;
  };
  LightBounds build(const Task& task);
  [[nodiscard]] u32 split(u32 begin, u32 end);
  static float best_plane(std::span<const Item> items, int axis, vec3 lower, vec3 upper);
  void compact();

  const u32 leaf_size_;
  std::vector<Item> items_;
  LightTree tree_;
};

LightBounds TreeBuilder::build(const Task& task) {
  const u32 count = task.end - task.begin;
  LightBounds bounds;
  u32 first = task.begin;
  if (count <= leaf_size_) {
    bounds = items_[task.begin].bounds;
    for (u32 i = task.begin + 1; i < task.end; ++i)
      bounds = kernels::merge(bounds, items_[i].bounds);
  } else {
    const u32 middle = split(task.begin, task.end);
    first = task.free;
    const Task left{first, task.node, first + 2, task.begin, middle};
    const Task right{first + 1, task.node, first + 2 + 2 * (middle - task.begin - 1), middle,
                     task.end};
    LightBounds a, b;
    if (count >= kParallel) {
      tbb::parallel_invoke([&] { a = build(left); }, [&] { b = build(right); });
    } else {
      a = build(left);
      b = build(right);
    }
    bounds = kernels::merge(a, b);
  }
  LightNode& node = tree_.nodes[task.node];
  node = kernels::node_of(bounds);
  node.first = first;
  node.parent = task.parent;
  node.count = count <= leaf_size_ ? kernels::u16(count) : kernels::u16(0);
  return bounds;
}

/// Where along an axis the two sides cost least.
float TreeBuilder::best_plane(std::span<const Item> items, int axis, vec3 lower, vec3 upper) {
  const float size = upper[axis] - lower[axis], scale = float(kBins) / size;
  std::array<Group, kBins> bins;
  for (const Item& item : items) {
    const u32 bin = u32((item.center[axis] - lower[axis]) * scale);
    bins[std::min(bin, kBins - 1)].add(item.bounds);
  }
  std::array<float, kBins> above{};
  const float smallest = 1e-3f * size;
  Group sum;
  for (u32 b = kBins - 1; b > 0; --b) {
    sum.add(bins[b]);
    above[b] = sum.cost(smallest);
  }
  sum = {};
  u32 best = kBins / 2;
  float best_cost = INFINITY;
  for (u32 b = 1; b < kBins; ++b) {
    sum.add(bins[b - 1]);
    const float cost = sum.cost(smallest) + above[b];
    if (sum.count > 0 && sum.count < items.size() && cost < best_cost) {
      best = b;
      best_cost = cost;
    }
  }
  return lower[axis] + float(best) / scale;
}

/// Parts items [begin, end) in two; returns where the second one begins.
u32 TreeBuilder::split(u32 begin, u32 end) {
  const auto items = std::span(items_).subspan(begin, end - begin);
  vec3 lower(INFINITY), upper(-INFINITY);
  for (const Item& item : items) {
    lower = glm::min(lower, item.center);
    upper = glm::max(upper, item.center);
  }
  const vec3 size = upper - lower;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const auto by_center = [axis](const Item& a, const Item& b) {
    return a.center[axis] < b.center[axis];
  };
  const u32 half = u32(items.size() / 2);
  if (items.size() > kFew && size[axis] > 0) {
    const float plane = items.size() > kMany ? 0.5f * (lower[axis] + upper[axis])
                                             : best_plane(items, axis, lower, upper);
    const auto middle = std::partition(items.begin(), items.end(),
                                       [&](const Item& item) { return item.center[axis] < plane; });
    if (middle != items.begin() && middle != items.end())
      return begin + u32(middle - items.begin());
  }
  std::nth_element(items.begin(), items.begin() + half, items.end(), by_center);
  return begin + half;
}

void TreeBuilder::compact() {
  std::vector<LightNode> kept{tree_.nodes[0]};
  for (u32 i = 0; i < kept.size(); ++i) {
    if (kept[i].count > 0) continue;
    const u32 from = kept[i].first;
    kept[i].first = u32(kept.size());
    for (u32 child = from; child < from + 2; ++child) {
      kept.push_back(tree_.nodes[child]);
      kept.back().parent = i;
    }
  }
  tree_.nodes = std::move(kept);
}

}  // namespace

LightTree build_light_tree(std::span<const LightBounds> elements, u32 leaf_size) {
  if (elements.empty()) return {};
  return TreeBuilder(elements, leaf_size).build();
}

}  // namespace heliograph::embree
