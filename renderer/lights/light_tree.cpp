// Light trees, top down by the surface area orientation heuristic over bins; many lights at first
// by halves of their extent, which is quicker.
#include "renderer/lights/light_tree.h"

#include <algorithm>
#include <array>

#include "renderer/base/parallel.h"

namespace heliograph::resident {
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

/// An element by its centre, and as a group of one.
struct Key {
  vec3 center;
  u32 element;
};
struct Item {
  Key key;
  Group group;
};

Item item_of(const Key& key, const LightBounds& b) {
  Item item{key, {b.lower, b.upper, vec3(0), b.power, 1}};
  if (b.cos_spread > -1 && !b.two_sided) item.group.axes = b.axis * (0.5f + 0.5f * b.cos_spread);
  return item;
}

const Key& key_of(const Key& key) { return key; }
const Key& key_of(const Item& item) { return item.key; }

/// Place along an axis where the two sides cost least.
float best_plane(std::span<const Item> items, int axis, vec3 lower, vec3 upper) {
  const float size = upper[axis] - lower[axis], scale = float(kBins) / size;
  std::array<Group, kBins> bins;
  for (const Item& item : items) {
    const u32 bin = u32((item.key.center[axis] - lower[axis]) * scale);
    bins[std::min(bin, kBins - 1)].add(item.group);
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

float plane_of(std::span<const Key>, int axis, vec3 lower, vec3 upper) {
  return 0.5f * (lower[axis] + upper[axis]);
}
float plane_of(std::span<const Item> items, int axis, vec3 lower, vec3 upper) {
  return best_plane(items, axis, lower, upper);
}

/// Parts keys or items in two; returns how many are in the first.
template <class T>
u32 split(std::span<T> items) {
  vec3 lower(INFINITY), upper(-INFINITY);
  for (const T& item : items) {
    lower = glm::min(lower, key_of(item).center);
    upper = glm::max(upper, key_of(item).center);
  }
  const vec3 size = upper - lower;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const u32 half = u32(items.size() / 2);
  if (items.size() > kFew && size[axis] > 0) {
    const float plane = plane_of(std::span<const T>(items), axis, lower, upper);
    const auto middle = std::partition(items.begin(), items.end(), [&](const T& item) {
      return key_of(item).center[axis] < plane;
    });
    if (middle != items.begin() && middle != items.end()) return u32(middle - items.begin());
  }
  std::nth_element(
      items.begin(), items.begin() + half, items.end(),
      [axis](const T& a, const T& b) { return key_of(a).center[axis] < key_of(b).center[axis]; });
  return half;
}

class TreeBuilder {
 public:
  TreeBuilder(std::span<const LightBounds> elements, u32 leaf_size)
      : elements_(elements), leaf_size_(leaf_size), items_(elements.size()) {
    keys_.reserve(elements.size());
    for (const LightBounds& b : elements) keys_.push_back({center_of(b), u32(keys_.size())});
    tree_.nodes.resize(2 * elements.size() - 1);
  }

  LightTree build() {
    const Task all{0, kernels::kNone, 1, 0, u32(keys_.size())};
    if (keys_.size() <= kMany) gather(all);
    tree_.bounds = build(all);
    tree_.order.reserve(items_.size());
    for (const Item& item : items_) tree_.order.push_back(item.key.element);
    if (leaf_size_ > 1) compact();
    return std::move(tree_);
  }

 private:
  /// Elements [begin, end) make `node`; what is beneath it lies at `free` and after. They are items
  /// where they are no more than kMany, else keys alone.
  struct Task {
    u32 node, parent, free, begin, end;
  };
  LightBounds build(const Task& task);
  [[nodiscard]] u32 parted(const Task& task);
  void gather(const Task& task) {
    for (u32 i = task.begin; i < task.end; ++i)
      items_[i] = item_of(keys_[i], elements_[keys_[i].element]);
  }
  void compact();

  const std::span<const LightBounds> elements_;
  const u32 leaf_size_;
  std::vector<Key> keys_;
  std::vector<Item> items_;
  LightTree tree_;
};

/// Parts the elements of a task; returns where the second half begins.
u32 TreeBuilder::parted(const Task& task) {
  const u32 count = task.end - task.begin;
  if (count <= kMany) return task.begin + split(std::span(items_).subspan(task.begin, count));
  return task.begin + split(std::span(keys_).subspan(task.begin, count));
}

LightBounds TreeBuilder::build(const Task& task) {
  const u32 count = task.end - task.begin;
  LightBounds bounds;
  u32 first = task.begin;
  if (count <= leaf_size_) {
    bounds = elements_[items_[task.begin].key.element];
    for (u32 i = task.begin + 1; i < task.end; ++i)
      bounds = kernels::merge(bounds, elements_[items_[i].key.element]);
  } else {
    const u32 middle = parted(task);
    first = task.free;
    const Task left{first, task.node, first + 2, task.begin, middle};
    const Task right{first + 1, task.node, first + 2 + 2 * (middle - task.begin - 1), middle,
                     task.end};
    for (const Task& half : {left, right})
      if (count > kMany && half.end - half.begin <= kMany) gather(half);
    LightBounds a, b;
    if (count >= kParallel) {
      parallel_invoke([&] { a = build(left); }, [&] { b = build(right); });
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

}  // namespace heliograph::resident
