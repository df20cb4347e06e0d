// Makes a Placement step by step: what moves in placement.cpp, what labels say in
// placer_labels.cpp.
#pragma once

#include <cmath>

#include "renderer/resident/placement.h"
#include "renderer/scene/grid.h"

namespace heliograph::resident {

inline mat4x3 scaled(const mat4x3& m, vec3 scale) {
  return {m[0] * scale.x, m[1] * scale.y, m[2] * scale.z, m[3]};
}

/// The steps are called in this order. Of an earlier placement of the same structure only what may
/// have changed is made anew; without one, everything.
class Placer {
 public:
  Placer(const Moment& now, Placeable what, const PlacedBefore* before,
         const PlacementContext& context);

  void worlds();
  Status meshes();
  void motion();
  void find_slots();
  Status label_frames();
  void instances();
  Status accelerate(const Placement* before);
  void volumes();
  std::shared_ptr<Placement> take() { return std::move(made_); }

 private:
  [[nodiscard]] const Structure& structure() const { return *made_->structure; }
  [[nodiscard]] bool is_changed(u32 entity) const { return all_ || changed_[entity] != 0; }
  [[nodiscard]] bool has_all_slots() const { return slots_.size() == structure().slots.size(); }
  void write_worlds_downwards();
  [[nodiscard]] kernels::InstanceView instance(u32 slot) const;
  void place(kernels::InstanceView& view, u32 slot) const;
  void find_rows();
  [[nodiscard]] std::vector<u32> slots_in(std::span<const u32> rows) const;
  void write_frames();
  [[nodiscard]] mat4x3 from_root(u32 entity, u32 root) const;
  [[nodiscard]] RestBox rest_box(const Instance& row, const ObjectFrame& frame) const;
  [[nodiscard]] bool keeps_box(u32 row) const;
  [[nodiscard]] RestBox box_of(u32 row) const;
  [[nodiscard]] const Grid& density(u32 entity) const {
    return *snapshot_.find(snapshot_.entities.at(entity).volume)->value->density;
  }
  void set_rest_box(RestBox own, u32 row, const mat4x3& root_from_entity,
                    kernels::InstanceView& view) const;

  const Snapshot& snapshot_;
  const TimeSpan span_;
  const Snapshot* then_ = nullptr;     // of before_
  const Placement* before_ = nullptr;  // of the same structure, or null
  const bool all_;                     // it is null
  const MeshBuilder& builder_;
  const Accelerator& accelerator_;
  const Interrupt& interrupt_;
  std::shared_ptr<Placement> made_ = std::make_shared<Placement>();
  std::vector<u32> entities_;    // that changed, or that something above them did; ascending
  std::vector<u8> changed_;      // by entity: is among them
  std::vector<u32> slots_;       // to be made; ascending
  std::vector<u32> rows_;        // of labels, to be made; ascending
  std::vector<u32> first_keys_;  // of Placement::moving, and where the last ones end
};

}  // namespace heliograph::resident
