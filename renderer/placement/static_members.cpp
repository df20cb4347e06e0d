#include "renderer/placement/static_members.h"

#include <algorithm>

namespace heliograph::resident {
namespace {

// A few large objects are found sooner through a top level of their boxes (9 of W1: by 15 %).
constexpr u32 kFewestStatic = 32;

bool same(const StaticMember& a, const StaticMember& b) {
  return a.visibility == b.visibility && a.mesh->accelerator == b.mesh->accelerator &&
         same_bytes(a.world, b.world);
}

}  // namespace

std::vector<StaticMember> static_members(const Placement& placement, u64 most_triangles) {
  std::vector<StaticMember> members;
  u64 triangles = 0;
  for (const u32 i : placement.structure->fixed) {
    const kernels::SlotView& slot = placement.slots[i];
    const auto& mesh = placement.meshes[slot.mesh];
    if (slot.segments > 0 || mesh->segments > 0) continue;
    const kernels::InstanceView view = placement.instance(i);
    if (!kernels::usable_pose(placement.world[slot.entity])) continue;
    if (mesh->shape() != kernels::Shape::kTriangles) continue;
    const u64 more = mesh->topology->triangles.size();
    if (triangles + more > most_triangles) continue;
    triangles += more;
    members.push_back({i, view.visibility, mesh, view.world_from_object});
  }
  if (members.size() < kFewestStatic) members.clear();
  return members;
}

bool same_members(std::span<const StaticMember> a, std::span<const StaticMember> b) {
  return std::ranges::equal(a, b, same);
}

bool kept_members(const Placement& now, const Kept& kept) {
  const Placement* before = kept.before;
  if (!before || before->structure != now.structure) return false;
  return std::ranges::all_of(now.structure->fixed, [&](u32 i) {
    if (kept.chunk(now, i / ChunkedArray<u32>::kRows)) return true;
    const u32 entity = now.structure->slots[i].entity;
    return kept.slot(now, i) == i && same_bytes(now.world[entity], before->world[entity]);
  });
}

}  // namespace heliograph::resident
