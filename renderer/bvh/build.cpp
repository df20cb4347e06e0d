// Binary trees to 8-wide ones: which subtrees become children, where they lie among their
// siblings, and their boxes in bytes.
#include "renderer/bvh/build.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

#include "renderer/bvh/binary_tree.h"

namespace heliograph::bvh {
namespace {

using kernels::BvhNode;
using kernels::kBvhChildren;

/// The subtrees that become the children of a wide node.
struct Children {
  u32 nodes[kBvhChildren];
  u32 count = 0;
  void add(u32 node) { nodes[count++] = node; }
};

/// Bytes along one axis of a node.
struct Grid {
  float origin = 0;
  int exponent = -126;
  double margin = 0;       // by which boxes grow, so that rounding while they are met loses nothing
  double cells = 0x1p126;  // a unit of length has so many

  Grid(float lower, float upper) {
    const double extent = double(upper) - double(lower);
    margin = extent * 0x1p-20;
    const double start = std::max(double(lower) - margin, -double(FLT_MAX));
    origin = float(start);
    if (double(origin) > start) origin = std::nextafter(origin, -FLT_MAX);
    const double reach = double(upper) + margin - double(origin);
    if (!(reach > 0)) return;
    exponent = std::max(-126, std::ilogb(reach / 255));
    while (std::ceil(std::ldexp(reach, -exponent)) > 255) ++exponent;
    cells = std::ldexp(1.0, -exponent);
  }
  [[nodiscard]] u8 low(float x) const {
    const double at = std::floor((double(x) - margin - double(origin)) * cells);
    return u8(std::clamp(at, 0.0, 255.0));
  }
  [[nodiscard]] u8 high(float x) const {
    const double at = std::ceil((double(x) + margin - double(origin)) * cells);
    return u8(std::clamp(at, 0.0, 255.0));
  }
};

class Widener {
 public:
  explicit Widener(BinaryTree tree) : binary_(std::move(tree)) {}
  Tree widen();

 private:
  struct Pending {
    u32 from;    // binary node
    u32 to;      // wide node
    u32 levels;  // of wide nodes that may be left, with this one
  };

  [[nodiscard]] Children children_of(const Pending& work) const;
  void gather(u32 node, u32 roots, Children& out) const;
  void open(u32 node, u32 levels, Children& out) const;
  void place(const LaneBox& box, Children& children) const;
  void emit(const Pending& work);

  BinaryTree binary_;
  Tree made_;
  std::vector<Pending> pending_;
};

/// What the plan makes of a subtree that stands for at most so many children.
void Widener::gather(u32 node, u32 roots, Children& out) const {
  const BinaryNode& n = binary_.nodes[node];
  while (roots > 1 && n.splits() && n.left_roots[roots - 1] == 0) --roots;
  if (roots == 1 || !n.splits()) {
    out.add(node);
    return;
  }
  const u32 left = n.left_roots[roots - 1];
  gather(binary_.left(node), left, out);
  gather(binary_.right(node), roots - left, out);
}

void Widener::open(u32 node, u32 levels, Children& out) const {
  if (levels == 0 || !binary_.nodes[node].splits()) {
    out.add(node);
    return;
  }
  open(binary_.left(node), levels - 1, out);
  open(binary_.right(node), levels - 1, out);
}

/// By the plan, as long as three binary levels in each wide node keep the tree within its depth.
Children Widener::children_of(const Pending& work) const {
  const BinaryNode& node = binary_.nodes[work.from];
  Children out;
  if (node.leaf)
    out.add(work.from);
  else if (node.height <= 3 * (work.levels - 1) + 1)
    gather(work.from, kBvhChildren, out);
  else
    open(work.from, 3, out);
  return out;
}

/// Orders children by their slots: a ray that goes up along all axes meets slot 0 first, one that
/// goes down along x slot 4, along y slot 2, along z slot 1. An empty slot is kNone.
///
/// Source: Ylitie, Karras and Laine 2017, section 3.2, with a greedy choice in place of an auction.
void Widener::place(const LaneBox& box, Children& children) const {
  const Lanes center = box.lower * 0.5f + box.upper * 0.5f;
  float gain[kBvhChildren][kBvhChildren];
  for (u32 c = 0; c < children.count; ++c) {
    const LaneBox& own = binary_.nodes[children.nodes[c]].box;
    const Lanes to = own.lower * 0.5f + own.upper * 0.5f - center;
    for (u32 s = 0; s < kBvhChildren; ++s)
      gain[c][s] = (s & 4 ? to[0] : -to[0]) + (s & 2 ? to[1] : -to[1]) + (s & 1 ? to[2] : -to[2]);
  }
  u32 slots[kBvhChildren];
  std::fill_n(slots, kBvhChildren, kernels::kNone);
  u32 placed = 0;
  for (u32 round = 0; round < children.count; ++round) {
    u32 child = kernels::kNone, slot = 0;
    for (u32 c = 0; c < children.count; ++c) {
      if (placed >> c & 1) continue;
      for (u32 s = 0; s < kBvhChildren; ++s) {
        if (slots[s] != kernels::kNone) continue;
        if (child != kernels::kNone && !(gain[c][s] > gain[child][slot])) continue;
        child = c;
        slot = s;
      }
    }
    slots[slot] = children.nodes[child];
    placed |= 1u << child;
  }
  std::copy_n(slots, kBvhChildren, children.nodes);
}

void Widener::emit(const Pending& work) {
  const LaneBox& box = binary_.nodes[work.from].box;
  Children children = children_of(work);
  const bool wraps_leaf = children.count == 1;  // a tree of one leaf
  place(box, children);
  const Grid grids[3] = {
      {box.lower[0], box.upper[0]}, {box.lower[1], box.upper[1]}, {box.lower[2], box.upper[2]}};
  BvhNode node{};
  node.first_child = u32(made_.nodes.size());
  node.first_item = u32(made_.items.size());
  for (int k = 0; k < 3; ++k) {
    node.origin[k] = grids[k].origin;
    node.exponent[k] = u8(grids[k].exponent + 127);
  }
  for (u32 slot = 0; slot < kBvhChildren; ++slot) {
    if (children.nodes[slot] == kernels::kNone) continue;
    const BinaryNode& child = binary_.nodes[children.nodes[slot]];
    for (int k = 0; k < 3; ++k) {
      node.low[k][slot] = grids[k].low(child.box.lower[k]);
      node.high[k][slot] = grids[k].high(child.box.upper[k]);
    }
    if (child.leaf || wraps_leaf) {
      const u32 offset = u32(made_.items.size()) - node.first_item;
      node.meta[slot] = u8(((1u << child.count) - 1) << 5 | offset);
      const auto items = binary_.items.begin() + child.first;
      made_.items.insert(made_.items.end(), items, items + child.count);
    } else {
      node.meta[slot] = u8(1u << 5 | (24 + slot));
      node.inner |= u8(1u << slot);
      pending_.push_back({children.nodes[slot], u32(made_.nodes.size()), work.levels - 1});
      made_.nodes.emplace_back();
    }
  }
  made_.nodes[work.to] = node;
}

Tree Widener::widen() {
  made_.nodes.emplace_back(BvhNode{});
  if (binary_.nodes.empty()) return std::move(made_);
  made_.items.reserve(binary_.items.size());
  pending_.push_back({0, 0, kernels::kBvhDepth});
  while (!pending_.empty()) {
    const Pending work = pending_.back();
    pending_.pop_back();
    emit(work);
  }
  return std::move(made_);
}

}  // namespace

Expected<Tree> build_tree(std::span<const Box> boxes, const TreeOptions& options,
                          const Interrupt& interrupt) {
  auto binary = build_binary(boxes, options, interrupt);
  if (!binary) return std::unexpected(std::move(binary).error());
  return Widener(*std::move(binary)).widen();
}

}  // namespace heliograph::bvh
