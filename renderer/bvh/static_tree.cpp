#include "renderer/bvh/static_tree.h"

#include <algorithm>
#include <ranges>

#include "renderer/base/parallel.h"
#include "renderer/bvh/build.h"

namespace heliograph::bvh {
namespace {

using resident::StaticMember;

constexpr TreeOptions kOptions{.item_cost = 0.3f};
constexpr u64 kMostTriangles = 1u << 30;  // that a builder counts

/// The triangles of some members, one after the other. Lifetime: of the members.
class Triangles {
 public:
  explicit Triangles(std::span<const StaticMember> members) : members_(members) {
    for (const StaticMember& member : members) {
      first_.push_back(count_);
      if (member.visibility != 0) count_ += u32(member.mesh->topology->triangles.size());
    }
  }
  [[nodiscard]] u32 count() const { return count_; }
  [[nodiscard]] Box box(u32 i) const {
    const Corners corners = at(i);
    Box box;
    for (const vec3& p : corners.world) box.extend(p);
    return box;
  }
  [[nodiscard]] kernels::BvhTriangle triangle(u32 i) const {
    const Corners corners = at(i);
    const vec3(&p)[3] = corners.world;
    return {p[0], corners.number, p[1], members_[corners.member].visibility, p[2], corners.member};
  }

 private:
  struct Corners {
    u32 member, number;
    vec3 world[3];
  };
  [[nodiscard]] Corners at(u32 i) const {
    const u32 member = u32(std::ranges::upper_bound(first_, i) - first_.begin()) - 1;
    const auto& [slot, visibility, mesh, world] = members_[member];
    Corners corners{member, i - first_[member], {}};
    const uvec3 vertices = mesh->topology->triangles.data()[corners.number];
    // The operations that Embree's group takes.
    for (int k = 0; k < 3; ++k)
      corners.world[k] = world * vec4(mesh->positions.data()[vertices[k]], 1);
    return corners;
  }

  std::span<const StaticMember> members_;
  std::vector<u32> first_;  // by member
  u32 count_ = 0;
};

/// f(i) of each.
template <class T, class F>
std::vector<T> made_of(u32 count, const F& f) {
  std::vector<T> made(count);
  parallel_ranges(count, 4096u, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i) made[i] = f(i);
  });
  return made;
}

Expected<std::shared_ptr<const StaticTree>> build(std::vector<StaticMember> members,
                                                  const Interrupt& interrupt) {
  auto made = std::make_shared<StaticTree>();
  made->members = std::move(members);
  const Triangles triangles(made->members);
  const auto boxes = made_of<Box>(triangles.count(), [&](u32 i) { return triangles.box(i); });
  auto tree = build_tree(boxes, kOptions, interrupt);
  if (!tree) return std::unexpected(std::move(tree).error());
  made->nodes = std::move(tree->nodes);
  made->triangles = made_of<kernels::BvhTriangle>(
      u32(tree->items.size()), [&](u32 i) { return triangles.triangle(tree->items[i]); });
  return made;
}

StaticGroup group_of(std::span<const StaticMember> members, u32 slots) {
  StaticGroup group;
  group.bits.resize((slots + 31) / 32);
  for (const StaticMember& member : members) {
    group.slots.push_back(member.slot);
    group.bits[member.slot / 32] |= 1u << (member.slot % 32);
  }
  return group;
}

}  // namespace

u64 StaticTree::bytes() const {
  return members.size() * sizeof(StaticMember) + nodes.size() * sizeof(kernels::BvhNode) +
         triangles.size() * sizeof(kernels::BvhTriangle);
}

kernels::StaticBvh StaticGroup::view() const {
  return {tree->nodes.data(), tree->triangles.data(), slots.data()};
}

StaticTrees::StaticTrees(u64 most_triangles)
    : most_triangles_(std::min(most_triangles, kMostTriangles)) {}

Expected<std::shared_ptr<const StaticGroup>> StaticTrees::group(
    const resident::Placement& placement, const resident::Kept& kept,
    const std::shared_ptr<const StaticGroup>& before, const Interrupt& interrupt) const {
  if (kept_members(placement, kept)) return before;
  std::vector<StaticMember> members = static_members(placement, most_triangles_);
  if (members.empty()) return nullptr;
  StaticGroup group = group_of(members, u32(placement.slots.size()));
  auto made = tree(std::move(members), interrupt);
  if (!made) return std::unexpected(std::move(made).error());
  group.tree = *std::move(made);
  // Arrays that stay where they are need not go to a device again.
  const bool is_same = before && before->tree == group.tree && before->slots == group.slots &&
                       before->bits == group.bits;
  return is_same ? before : std::make_shared<const StaticGroup>(std::move(group));
}

Expected<std::shared_ptr<const StaticTree>> StaticTrees::tree(std::vector<StaticMember> members,
                                                              const Interrupt& interrupt) const {
  const std::shared_ptr<Slot> slot = slot_of(std::move(members));
  const std::scoped_lock lock(slot->mutex);
  if (auto tree = slot->tree.lock()) return tree;
  auto made = run_alone([&] { return build(slot->members, interrupt); });
  if (made) slot->tree = *made;
  return made;
}

std::shared_ptr<StaticTrees::Slot> StaticTrees::slot_of(std::vector<StaticMember> members) const {
  const std::scoped_lock lock(mutex_);
  std::erase_if(slots_,
                [](const auto& slot) { return slot.use_count() == 1 && slot->tree.expired(); });
  for (const auto& slot : slots_ | std::views::reverse)
    if (same_members(slot->members, members)) return slot;
  return slots_.emplace_back(std::make_shared<Slot>(std::move(members)));
}

}  // namespace heliograph::bvh
