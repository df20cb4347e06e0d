// Makes a Placement step by step: what moves in placement.cpp, what labels say in
// placer_labels.cpp.
#pragma once

#include <cmath>
#include <cstring>

#include "renderer/resident/placement.h"
#include "renderer/scene/grid.h"

namespace heliograph::resident {

inline bool same(const mat4x3& a, const mat4x3& b) { return std::memcmp(&a, &b, sizeof a) == 0; }

inline mat4x3 scaled(const mat4x3& m, vec3 scale) {
  return {m[0] * scale.x, m[1] * scale.y, m[2] * scale.z, m[3]};
}

/// Slots that a thread takes at a time.
inline constexpr u32 kSlotGrain = 256;

/// Makes a Placement step by step.
class Placer {
 public:
  Placer(const Snapshot& snapshot, const TimeSpan& span, std::shared_ptr<const Structure> structure,
         const Placement* before, const PlacementContext& context)
      : snapshot_(snapshot),
        span_(span),
        before_(before),
        builder_(context.builder),
        accelerator_(context.accelerator),
        interrupt_(context.interrupt) {
    made_->span = span;
    made_->structure = std::move(structure);
    made_->world = world_poses(snapshot, span.middle());
  }

  Status meshes();
  void motion();
  void instances();
  Status label_frames();
  void boxes();
  void volumes();
  Status accelerate();
  std::shared_ptr<Placement> take() { return std::move(made_); }

 private:
  [[nodiscard]] u32 slot_before(const Slot& slot) const;
  [[nodiscard]] bool takes_over(u32 slot, u32 old) const;
  void instance(u32 slot);
  void place(u32 slot);
  void add_keys(kernels::InstanceView& view, const std::vector<kernels::MotionKey>& keys);
  [[nodiscard]] mat4x3 from_root(u32 entity, u32 root) const;
  [[nodiscard]] RestBox rest_box(const Instance& row, const ObjectFrame& frame) const;
  [[nodiscard]] bool keeps_box(u32 row) const;
  /// The frame and box of a row, and what its slots have in them.
  void label_row(u32 row);
  [[nodiscard]] const Grid& density(u32 entity) const {
    return *snapshot_.find(snapshot_.entities.at(entity).volume)->value->density;
  }
  void set_rest_box(RestBox own, u32 row, const mat4x3& root_from_entity,
                    kernels::InstanceView& view) const;

  const Snapshot& snapshot_;
  const TimeSpan span_;
  const Placement* before_;
  const MeshBuilder& builder_;
  const Accelerator& accelerator_;
  const Interrupt& interrupt_;
  std::shared_ptr<Placement> made_ = std::make_shared<Placement>();
  std::vector<std::vector<kernels::MotionKey>> keys_;  // by slot; empty: it stands still
  std::vector<u32> kept_;                              // by slot: Kept::slots
  std::vector<u8> moved_;                              // by slot
};

}  // namespace heliograph::resident
