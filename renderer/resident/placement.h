// Where the slots of a structure are in a span of time: instances, what rays go through, frames of
// labels.
#pragma once

#include "renderer/engine/backend.h"
#include "renderer/engine/label_columns.h"
#include "renderer/resident/structure.h"

namespace heliograph::resident {

/// Whether an instance can be shown with this matrix.
[[nodiscard]] inline bool usable_pose(const mat4x3& m) {
  const float det = glm::determinant(mat3(m));
  return std::isfinite(det) && det != 0 && std::isfinite(m[3].x + m[3].y + m[3].z);
}

struct Placement {
  TimeSpan span;
  std::shared_ptr<const Structure> structure;
  std::vector<mat4x3> world;                              // by entity index, in the middle
  std::vector<kernels::InstanceView> instances;           // by slot
  std::vector<kernels::InstanceView> volumes;             // of Structure::volumes; without meshes
  std::vector<std::shared_ptr<const DeviceMesh>> meshes;  // the structure's, then deformed ones
  std::vector<u32> mesh_of_slot;                          // index into meshes
  std::vector<kernels::MotionKey> motion_keys;            // of the instances
  std::vector<mat4x3> root_from_entity;                   // by slot, of its mesh's coordinates
  std::vector<ObjectFrame> frames;                        // by row of the labelling, in the middle
  std::vector<RestBox> boxes;                             // by row, in those frames
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

/// Places every slot over `span`; an instant, or what does not move in it, has no keys. What
/// `before` has in the same place is taken over; the result does not depend on it. Fails with
/// RESOURCE_EXHAUSTED, and as the interrupt says.
[[nodiscard]] Expected<std::shared_ptr<const Placement>> make_placement(
    const Snapshot& snapshot, const TimeSpan& span, std::shared_ptr<const Structure> structure,
    const Placement* before, const PlacementContext& context);

}  // namespace heliograph::resident
