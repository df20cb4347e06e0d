// Where the slots of a structure are in a span of time: instances, what rays go through, frames of
// labels.
#pragma once

#include <cstring>

#include "renderer/engine/backend.h"
#include "renderer/engine/label_columns.h"
#include "renderer/resident/changes.h"
#include "renderer/resident/surfaces.h"

namespace heliograph::resident {

template <class T>
bool same_bytes(const T& a, const T& b) {
  static_assert(std::is_trivially_copyable_v<T>);
  return std::memcmp(&a, &b, sizeof a) == 0;
}

/// Whether an instance can be shown with this matrix.
[[nodiscard]] inline bool usable_pose(const mat4x3& m) {
  const float det = glm::determinant(mat3(m));
  return std::isfinite(det) && det != 0 && std::isfinite(m[3].x + m[3].y + m[3].z);
}

/// Tables share the chunks of what did not change with the placement that this one was made from.
/// Where an instance's chunk is shared, so is all else of those slots: keys, mesh, label.
struct Placement {
  TimeSpan span;
  std::shared_ptr<const Structure> structure;
  HoleSlots holes;
  ChunkedArray<mat4x3> world;                             // by entity index, in the middle
  ChunkedArray<kernels::InstanceView> instances;          // by slot
  std::vector<kernels::InstanceView> volumes;             // of Structure::volumes; without meshes
  std::vector<std::shared_ptr<const DeviceMesh>> meshes;  // the structure's, then deformed ones
  ChunkedArray<u32> mesh_of_slot;                         // index into meshes
  std::vector<u32> deformed;                              // slots that show those, in their order
  std::vector<u32> moving;                                // slots that have keys, ascending
  std::vector<kernels::MotionKey> motion_keys;            // of the instances
  ChunkedArray<mat4x3> root_from_entity;                  // by slot, of its mesh's coordinates
  ChunkedArray<ObjectFrame> frames;                       // by row of the labelling, in the middle
  ChunkedArray<RestBox> boxes;                            // by row, in those frames
  std::shared_ptr<const SceneAccelerator> accelerator;    // null: no instance
  Box bounds;
  /// What takes the coordinates of a slot's mesh to the world.
  [[nodiscard]] mat4x3 mesh_pose(u32 slot) const;
  /// Motion keys of a slot; empty: it stands still.
  [[nodiscard]] std::span<const kernels::MotionKey> keys_of(u32 slot) const;
};

/// What a placement is made with.
struct PlacementContext {
  const MeshBuilder& builder;
  const Accelerator& accelerator;
  const Interrupt& interrupt;
};

/// What is placed.
struct Placeable {
  std::shared_ptr<const Structure> structure;
  HoleSlots holes;
};

/// What was placed before.
struct PlacedBefore {
  const Snapshot& snapshot;
  const Placement& placement;
};

/// Places every slot over a span; an instant, or what does not move in it, has no keys. What
/// `before`, or null, has in the same place is taken over; the result does not depend on it. Fails
/// with RESOURCE_EXHAUSTED, and as the interrupt says.
[[nodiscard]] Expected<std::shared_ptr<const Placement>> make_placement(
    const Moment& moment, Placeable what, const PlacedBefore* before,
    const PlacementContext& context);

}  // namespace heliograph::resident
