// Frames and boxes of labels.

#include <algorithm>
#include <iterator>
#include <numeric>

#include "renderer/resident/placer.h"
#include "renderer/resident/rest_box.h"

namespace heliograph::resident {
namespace {

constexpr u32 kRows = ChunkedArray<u32>::kRows;

/// Writes rows of a chunk, which is cloned with the first that differs.
template <class T>
class RowWriter {
 public:
  /// is_there   the chunk has rows that were written before
  RowWriter(ChunkedArray<T>& rows, u32 chunk, bool is_there)
      : rows_(rows), chunk_(chunk), is_there_(is_there) {}
  void set(u32 row, const T& value) {
    if (is_there_ && same_bytes(rows_.chunk(chunk_)[row], value)) return;
    if (!is_mine_) mine_ = rows_.write_chunk(chunk_);
    is_mine_ = is_there_ = true;
    mine_[row] = value;
  }

 private:
  ChunkedArray<T>& rows_;
  const u32 chunk_;
  bool is_there_, is_mine_ = false;
  std::span<T> mine_;
};

}  // namespace

mat4x3 Placer::from_root(u32 entity, u32 root) const {
  mat4x3 result(1);
  for (u32 i = entity; i != root;) {
    const EntityId parent = snapshot_.entities.at(i).parent;
    if (!parent) return multiply(inverse(made_->world[root]), made_->world[entity]);
    result = multiply(local_pose(snapshot_, i, span_.middle()), result);
    i = parent.index();
  }
  return result;
}

RestBox Placer::rest_box(const Instance& row, const ObjectFrame& frame) const {
  // A rigid frame's scale keeps the sides of a box: bounds are then those of the root's frame,
  // which do not change when the root moves.
  const mat3 from_root_map =
      frame.rigid ? mat3(1) : object_from_root(frame, made_->world[row.root]);
  const vec3 scale = frame.rigid ? frame.scale : vec3(1);
  RestBox box;
  for (const u32 entity : row.entities) {
    const u32 slot = structure().slot_of_entity[entity];
    if (slot == kNone) {  // a volume
      const mat4x3 to_root = from_root(entity, row.root);
      for (const vec3& corner : box_corners(density(entity))) {
        const vec3 p = from_root_map * (to_root * vec4(corner, 1)) * scale;
        box.lower = glm::min(box.lower, p);
        box.upper = glm::max(box.upper, p);
      }
      continue;
    }
    const mat4x3& to_root = made_->root_from_entity[slot];
    const DeviceMesh& mesh = *made_->meshes[made_->mesh_of_slot[slot]];
    const mat3 map = from_root_map * mat3(to_root);
    const Box part = map == mat3(1) ? mesh.rest : builder_.rest_bounds(mesh, map);
    const vec3 offset = from_root_map * to_root[3];
    box.lower = glm::min(box.lower, (part.lower + offset) * scale);
    box.upper = glm::max(box.upper, (part.upper + offset) * scale);
  }
  return box;
}

/// Rows with volumes are always made anew, for volumes have no slots.
void Placer::find_rows() {
  const u32 count = u32(structure().labelling.instances.size());
  if (all_ || (has_all_slots() && entities_.size() == snapshot_.entities.count())) {
    rows_.resize(count);
    std::iota(rows_.begin(), rows_.end(), 0u);
    return;
  }
  for (const u32 slot : slots_) rows_.push_back(structure().slots[slot].row);
  for (const u32 entity : entities_) rows_.push_back(structure().row_of_root[entity]);
  for (const VolumeSlot& volume : structure().volumes) rows_.push_back(volume.row);
  std::erase(rows_, kNone);
  make_ascending(rows_, count);
}

std::vector<u32> Placer::slots_in(std::span<const u32> rows) const {
  std::vector<u32> slots;
  for (const u32 row : rows)
    for (const u32 entity : structure().labelling.instances[row].entities)
      if (const u32 slot = structure().slot_of_entity[entity]; slot != kNone) slots.push_back(slot);
  make_ascending(slots, u32(structure().slots.size()));
  return slots;
}

Status Placer::label_frames() {
  find_rows();
  std::vector<u32> other;  // rows whose frames or boxes change
  const auto& instances = structure().labelling.instances;
  if (!has_all_slots()) {
    std::ranges::copy_if(rows_, std::back_inserter(other),
                         [&](u32 row) { return is_changed(instances[row].root); });
    merge(slots_, slots_in(other));
  }
  auto& to_root = made_->root_from_entity;
  to_root = before_ ? before_->root_from_entity
                    : ChunkedArray<mat4x3>::unwritten(u32(structure().slots.size()));
  for_each_chunk(slots_, [&](u32 c, std::span<const u32> slots) {
    RowWriter writer(to_root, c, before_ != nullptr);
    for (const u32 i : slots) {
      const Slot& slot = structure().slots[i];
      writer.set(i % kRows,
                 slot.row == kNone
                     ? mat4x3(1)
                     : scaled(from_root(slot.entity, instances[slot.row].root), slot.scale));
    }
  });
  write_frames();
  HELIO_TRY(interrupt_.status());
  if (has_all_slots()) return {};
  other.clear();
  std::ranges::copy_if(rows_, std::back_inserter(other), [&](u32 row) {
    return !same_bytes(made_->boxes[row], before_->boxes[row]);
  });
  merge(slots_, slots_in(other));
  return {};
}

void Placer::write_frames() {
  const u32 count = u32(structure().labelling.instances.size());
  made_->frames = before_ ? before_->frames : ChunkedArray<ObjectFrame>::unwritten(count);
  made_->boxes = before_ ? before_->boxes : ChunkedArray<RestBox>::unwritten(count);
  for_each_chunk(rows_, [&](u32 c, std::span<const u32> rows) {
    RowWriter boxes(made_->boxes, c, before_ != nullptr);
    RowWriter frames(made_->frames, c, before_ != nullptr);
    for (const u32 row : rows) {
      if (interrupt_.requested()) return;
      const u32 root = structure().labelling.instances[row].root;
      if (is_changed(root)) frames.set(row % kRows, object_frame(made_->world[root]));
      boxes.set(row % kRows, box_of(row));
    }
  });
}

RestBox Placer::box_of(u32 row) const {
  if (before_ && keeps_box(row)) return before_->boxes[row];
  return rest_box(structure().labelling.instances[row], made_->frames[row]);
}

/// Whether an instance has moved and nothing else.
bool Placer::keeps_box(u32 row) const {
  const ObjectFrame &now = made_->frames[row], &then = before_->frames[row];
  if (!now.rigid || !then.rigid || now.scale != then.scale) return false;
  return std::ranges::all_of(structure().labelling.instances[row].entities, [&](u32 entity) {
    const u32 slot = structure().slot_of_entity[entity];
    return slot != kNone &&
           same_bytes(made_->root_from_entity[slot], before_->root_from_entity[slot]) &&
           made_->meshes[made_->mesh_of_slot[slot]] == before_->meshes[before_->mesh_of_slot[slot]];
  });
}

/// box   of the rest vertices, which serves an entity that has no row
void Placer::set_rest_box(RestBox box, u32 row, const mat4x3& root_from_entity,
                          kernels::InstanceView& view) const {
  mat4x3 to_object(1);
  if (row != kNone) {
    const mat3 scale = object_from_root(made_->frames[row],
                                        made_->world[structure().labelling.instances[row].root]);
    box = made_->boxes[row];
    to_object = multiply(mat4x3(scale[0], scale[1], scale[2], vec3(0)), root_from_entity);
  }
  show_rest_box(box, to_object, view);
}

}  // namespace heliograph::resident
