// Parts of an earlier placement that stay. Declared in accelerator.h.
#include <algorithm>

#include "renderer/placement/placement.h"

namespace heliograph::resident {
namespace {

constexpr u32 kRows = ChunkedArray<u32>::kRows;

/// True if they are the same bits.
bool same_keys(std::span<const kernels::MotionKey> a, std::span<const kernels::MotionKey> b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

}  // namespace

bool Kept::chunk(const Placement& now, u32 chunk) const {
  if (!before || before->structure != now.structure || !now.slots.shares(chunk, before->slots))
    return false;
  const auto slots = now.slots.chunk(chunk);
  const auto is_shared = [&](u32 world) { return now.world.shares(world, before->world); };
  u32 world = slots.front().entity / kRows;
  while (world <= slots.back().entity / kRows && is_shared(world)) ++world;
  if (world > slots.back().entity / kRows) return true;
  return std::ranges::all_of(slots, [&](const kernels::SlotView& slot) {
    return is_shared(slot.entity / kRows) ||
           same_bytes(now.world[slot.entity], before->world[slot.entity]);
  });
}

u32 Kept::slot(const Placement& now, u32 slot) const {
  if (!before) return kNone;
  u32 old = slot;
  if (before->structure != now.structure) {
    const auto& slots = before->structure->slot_of_entity;
    const u32 entity = now.slots[slot].entity;
    old = entity < slots.size() ? slots[entity] : kNone;
    if (old == kNone) return kNone;
  }
  const bool same = now.slots[slot].visibility == before->slots[old].visibility &&
                    same_bytes(now.mesh_pose(slot), before->mesh_pose(old)) &&
                    same_keys(now.keys_of(slot), before->keys_of(old)) &&
                    now.mesh(slot).accelerator == before->mesh(old).accelerator;
  return same ? old : kNone;
}

}  // namespace heliograph::resident
