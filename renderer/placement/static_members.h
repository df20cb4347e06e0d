// The instances of a placement that a backend traces as one mesh in world space: those of entities
// that are marked as static. Called by the backends' accelerators.
#pragma once

#include "renderer/placement/placement.h"

namespace heliograph::resident {

struct StaticMember {
  u32 slot;
  u32 visibility;                          // ray mask bits
  std::shared_ptr<const DeviceMesh> mesh;  // of triangles, which do not deform
  mat4x3 world;
};

/// Static entities in the order of their slots, as long as there is room; those that move in the
/// span are none. A few are none, either.
///
/// most_triangles   of all members
[[nodiscard]] std::vector<StaticMember> static_members(const Placement& placement,
                                                       u64 most_triangles);

/// True if they are the same triangles to the same rays, whatever their slots.
[[nodiscard]] bool same_members(std::span<const StaticMember> a, std::span<const StaticMember> b);

/// True if the members are sure to be those of the placement before, in the same slots.
[[nodiscard]] bool kept_members(const Placement& now, const Kept& kept);

}  // namespace heliograph::resident
