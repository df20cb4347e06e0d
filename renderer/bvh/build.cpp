// Binary trees to 8-wide ones: which subtrees become children, and where nodes and items lie.
#include "renderer/bvh/build.h"

#include "kernels/bvh/bvh_pack.h"
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
  void emit(const Pending& work);

  BinaryTree binary_;
  Tree made_;
  std::vector<Pending> pending_;
};

/// Gathers what the plan makes of a subtree that stands for at most so many children.
void Widener::gather(u32 node, u32 roots, Children& out) const {
  const BinaryNode& n = binary_.nodes[node];
  roots = n.splits() ? kernels::planned_roots(n.plan, roots) : 1;
  if (roots == 1) {
    out.add(node);
    return;
  }
  const u32 left = n.plan.left_roots[roots - 1];
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
  if (node.plan.leaf)
    out.add(work.from);
  else if (node.height <= 3 * (work.levels - 1) + 1)
    gather(work.from, kBvhChildren, out);
  else
    open(work.from, 3, out);
  return out;
}

void Widener::emit(const Pending& work) {
  const Children from = children_of(work);
  const bool wraps_leaf = from.count == 1;  // a tree of one leaf
  kernels::BvhChild slots[kBvhChildren];
  for (u32 i = 0; i < from.count; ++i) {
    const BinaryNode& child = binary_.nodes[from.nodes[i]];
    slots[i] = {child.box.box(), from.nodes[i], child.plan.leaf || wraps_leaf ? child.count : 0};
  }
  const kernels::BvhBox box = binary_.nodes[work.from].box.box();
  kernels::order_children(slots, from.count, box);
  BvhNode node = kernels::pack_node(slots, box);
  node.first_child = u32(made_.nodes.size());
  node.first_item = u32(made_.items.size());
  for (const kernels::BvhChild& slot : slots) {
    if (slot.source == kernels::kNone) continue;
    if (slot.items > 0) {
      const auto items = binary_.items.begin() + binary_.nodes[slot.source].first;
      made_.items.insert(made_.items.end(), items, items + slot.items);
    } else {
      pending_.push_back({slot.source, u32(made_.nodes.size()), work.levels - 1});
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
