// Where the slots of a structure are in a span of time, and what rays go through there.
#pragma once

#include <cstring>

#include "kernels/geometry/place.h"
#include "renderer/device/backend.h"
#include "renderer/placement/changes.h"
#include "renderer/placement/label_frames.h"
#include "renderer/placement/surfaces.h"

namespace heliograph::resident {

template <class T>
bool same_bytes(const T& a, const T& b) {
  static_assert(std::is_trivially_copyable_v<T>);
  return std::memcmp(&a, &b, sizeof a) == 0;
}

/// Tables share the chunks of what did not change with the placement that this one was made from.
/// Instances and labels, which few scenes are asked for, are made then. Thread: any.
class Placement {
 public:
  TimeSpan span;
  std::shared_ptr<const Structure> structure;
  HoleSlots holes;
  ChunkedArray<mat4x3> world;  // by entity index, in the middle; perhaps the snapshot's chunks
  ChunkedArray<kernels::SlotView> slots;
  std::vector<kernels::InstanceView> volumes;             // of Structure::volumes; without meshes
  std::vector<std::shared_ptr<const DeviceMesh>> meshes;  // the structure's, then deformed ones
  std::vector<u32> deformed;                              // slots that show those, in their order
  std::vector<u32> moving;                                // slots that have keys, ascending
  std::vector<kernels::MotionKey> motion_keys;            // of the instances
  std::shared_ptr<const SceneAccelerator> accelerator;    // null: no instance
  Box bounds;

  /// Map from the coordinates of a slot's mesh to the world.
  [[nodiscard]] mat4x3 mesh_pose(u32 slot) const;
  [[nodiscard]] const DeviceMesh& mesh(u32 slot) const { return *meshes[slots[slot].mesh]; }
  /// Motion keys of a slot; empty: it stands still.
  [[nodiscard]] std::span<const kernels::MotionKey> keys_of(u32 slot) const;
  [[nodiscard]] kernels::InstanceView instance(u32 slot) const;
  /// All of them, by slot.
  [[nodiscard]] const ChunkedArray<kernels::InstanceView>& instances() const;
  /// Frames and boxes that labels measure by. Fails as the interrupt does.
  ///
  /// snapshot   any that has the same entities and poses
  [[nodiscard]] Expected<const LabelFrames*> labels(const Snapshot& snapshot,
                                                    const MeshBuilder& builder,
                                                    const Interrupt& interrupt) const;

 private:
  friend class Placer;
  // Instances of the placement that this one was made from, if it had them:
  struct InstancesBefore {
    ChunkedArray<kernels::InstanceView> rows;
    std::vector<u8> stay{};  // by chunk, whether they are these
  };
  mutable std::optional<InstancesBefore> instances_before_;  // until there are instances
  mutable LabelsBefore labels_before_;                       // the same of labels
  Lazy<ChunkedArray<kernels::InstanceView>> instances_;
  Lazy<LabelFrames> labels_;
};

/// Tools for making a placement.
struct PlacementContext {
  const MeshBuilder& builder;
  const Accelerator& accelerator;
  const Interrupt& interrupt;
};

/// Things that are placed.
struct Placeable {
  std::shared_ptr<const Structure> structure;
  HoleSlots holes;
};

/// Placement of before.
struct PlacedBefore {
  const Snapshot& snapshot;
  const Placement& placement;
};

/// Places every slot over a span; an instant, or what does not move in it, has no keys. What
/// `before`, or null, has in the same place is taken over; the result does not depend on it. Fails
/// with RESOURCE_EXHAUSTED, and as the interrupt does.
[[nodiscard]] Expected<std::shared_ptr<const Placement>> make_placement(
    const Moment& moment, Placeable what, const PlacedBefore* before,
    const PlacementContext& context);

}  // namespace heliograph::resident
