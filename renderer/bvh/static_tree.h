// Entities that are marked as static as one tree over their triangles in world space. Called by
// accelerator.cpp.
#pragma once

#include <mutex>

#include "kernels/bvh/bvh.h"
#include "renderer/placement/static_members.h"

namespace heliograph::bvh {

/// Immutable.
struct StaticTree {
  std::vector<resident::StaticMember> members;
  std::vector<kernels::BvhNode> nodes;
  std::vector<kernels::BvhTriangle> triangles;  // in the order of leaves
  [[nodiscard]] u64 bytes() const;
};

/// The members of a placement. Immutable.
struct StaticGroup {
  std::shared_ptr<const StaticTree> tree;  // its members may have had other slots
  std::vector<u32> slots;                  // by member
  std::vector<u32> bits;                   // one for each slot: whether it is a member
  [[nodiscard]] bool has(u32 slot) const { return (bits[slot / 32] >> (slot % 32) & 1) != 0; }
  [[nodiscard]] kernels::StaticBvh view() const;
};

/// Makes groups, and knows the trees in use: placements whose members are equal share one. Thread:
/// any; of some that want the same tree one makes it while the others wait.
class StaticTrees {
 public:
  /// most_triangles   of a tree
  explicit StaticTrees(u64 most_triangles);

  /// Null without members. Fails as the interrupt does.
  ///
  /// before   the group of the placement before, or null
  [[nodiscard]] Expected<std::shared_ptr<const StaticGroup>> group(
      const resident::Placement& placement, const resident::Kept& kept,
      const std::shared_ptr<const StaticGroup>& before, const Interrupt& interrupt) const;

 private:
  [[nodiscard]] Expected<std::shared_ptr<const StaticTree>> tree(
      std::vector<resident::StaticMember> members, const Interrupt& interrupt) const;

  const u64 most_triangles_;
  /// A tree that is there or is being made.
  struct Slot {
    const std::vector<resident::StaticMember> members;
    std::mutex mutex;  // held while it is made
    std::weak_ptr<const StaticTree> tree;
  };
  [[nodiscard]] std::shared_ptr<Slot> slot_of(std::vector<resident::StaticMember> members) const;

  mutable std::mutex mutex_;
  mutable std::vector<std::shared_ptr<Slot>> slots_;  // by mutex_
};

}  // namespace heliograph::bvh
