#include "renderer/placement/label_frames.h"

#include <algorithm>
#include <numeric>

#include "renderer/placement/placement.h"
#include "renderer/placement/rest_box.h"
#include "renderer/scene/grid.h"
#include "renderer/scene/motion.h"

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

const Grid& density(const Snapshot& snapshot, u32 entity) {
  return *snapshot.find(snapshot.entities.at(entity).volume)->value->density;
}

/// Map from an entity's coordinates to those of one above it.
mat4x3 from_root(const Snapshot& snapshot, const Placement& placement, u32 entity, u32 root) {
  mat4x3 result(1);
  for (u32 i = entity; i != root;) {
    const EntityId parent = snapshot.entities.at(i).parent;
    if (!parent) return multiply(inverse(placement.world[root]), placement.world[entity]);
    result = multiply(local_pose(snapshot, i, placement.span.middle()), result);
    i = parent.index();
  }
  return result;
}

/// Maker of what may have changed since labels that were there, or without such of everything.
class Labeller {
 public:
  explicit Labeller(const LabelSources& sources)
      : snapshot_(sources.snapshot),
        placement_(sources.placement),
        builder_(sources.builder),
        before_(sources.before.labels ? &*sources.before.labels : nullptr) {
    if (before_) made_ = *before_;
    made_.slots = placement_.slots;
    made_.meshes = placement_.meshes;
    find_rows(sources.before);
  }
  void roots();
  void frames(const Interrupt& interrupt);
  LabelFrames take() { return std::move(made_); }

 private:
  [[nodiscard]] const Structure& structure() const { return *placement_.structure; }
  [[nodiscard]] const std::vector<Instance>& instances() const {
    return structure().labelling.instances;
  }
  void find_rows(const LabelsBefore& before);
  [[nodiscard]] RestBox rest_box(const Instance& row, const ObjectFrame& frame) const;
  [[nodiscard]] bool keeps_box(u32 row) const;

  const Snapshot& snapshot_;
  const Placement& placement_;
  const MeshBuilder& builder_;
  const LabelFrames* before_;
  LabelFrames made_;
  std::vector<u32> rows_;   // to be made; ascending
  std::vector<u32> slots_;  // of those, or of none that changed; ascending
};

/// Rows with volumes are always made anew, for volumes have no slots.
void Labeller::find_rows(const LabelsBefore& before) {
  const u32 row_count = u32(instances().size()), slot_count = u32(structure().slots.size());
  if (!before_) {
    made_.root_from_entity = ChunkedArray<mat4x3>::unwritten(slot_count);
    made_.frames = ChunkedArray<ObjectFrame>::unwritten(row_count);
    made_.boxes = ChunkedArray<RestBox>::unwritten(row_count);
  }
  if (!before_ || before.entities.size() == snapshot_.entities.count()) {
    rows_.resize(row_count);
    slots_.resize(slot_count);
    std::iota(rows_.begin(), rows_.end(), 0u);
    std::iota(slots_.begin(), slots_.end(), 0u);
    return;
  }
  slots_ = slots_of(structure(), before.entities);
  merge(slots_, before.deformed);
  for (const u32 slot : slots_) rows_.push_back(structure().slots[slot].row);
  for (const u32 entity : before.entities) rows_.push_back(structure().row_of_root[entity]);
  for (const VolumeSlot& volume : structure().volumes) rows_.push_back(volume.row);
  std::erase(rows_, kNone);
  make_ascending(rows_, row_count);
  std::vector<u32> shown;
  for (const u32 row : rows_)
    for (const u32 entity : instances()[row].entities)
      if (const u32 slot = structure().slot_of_entity[entity]; slot != kNone) shown.push_back(slot);
  make_ascending(shown, slot_count);
  merge(slots_, std::move(shown));
}

void Labeller::roots() {
  for_each_chunk(slots_, [&](u32 c, std::span<const u32> slots) {
    RowWriter writer(made_.root_from_entity, c, before_ != nullptr);
    for (const u32 i : slots) {
      const Slot& slot = structure().slots[i];
      writer.set(i % kRows, slot.row == kNone
                                ? mat4x3(1)
                                : kernels::scaled(from_root(snapshot_, placement_, slot.entity,
                                                            instances()[slot.row].root),
                                                  slot.scale));
    }
  });
}

void Labeller::frames(const Interrupt& interrupt) {
  for_each_chunk(rows_, [&](u32 c, std::span<const u32> rows) {
    RowWriter boxes(made_.boxes, c, before_ != nullptr);
    RowWriter frames(made_.frames, c, before_ != nullptr);
    for (const u32 row : rows) {
      if (interrupt.requested()) return;
      const Instance& instance = instances()[row];
      frames.set(row % kRows, object_frame(placement_.world[instance.root]));
      boxes.set(row % kRows, before_ && keeps_box(row) ? before_->boxes[row]
                                                       : rest_box(instance, made_.frames[row]));
    }
  });
}

RestBox Labeller::rest_box(const Instance& row, const ObjectFrame& frame) const {
  // A rigid frame's scale keeps the sides of a box: bounds are then those of the root's frame,
  // which do not change when the root moves.
  const mat3 from_root_map =
      frame.rigid ? mat3(1) : object_from_root(frame, placement_.world[row.root]);
  const vec3 scale = frame.rigid ? frame.scale : vec3(1);
  RestBox box;
  for (const u32 entity : row.entities) {
    const u32 slot = structure().slot_of_entity[entity];
    if (slot == kNone) {  // a volume
      const mat4x3 to_root = from_root(snapshot_, placement_, entity, row.root);
      for (const vec3& corner : box_corners(density(snapshot_, entity))) {
        const vec3 p = from_root_map * (to_root * vec4(corner, 1)) * scale;
        box.lower = glm::min(box.lower, p);
        box.upper = glm::max(box.upper, p);
      }
      continue;
    }
    const mat4x3& to_root = made_.root_from_entity[slot];
    const DeviceMesh& mesh = placement_.mesh(slot);
    const mat3 map = from_root_map * mat3(to_root);
    const Box part = map == mat3(1) ? mesh.rest : builder_.rest_bounds(mesh, map);
    const vec3 offset = from_root_map * to_root[3];
    box.lower = glm::min(box.lower, (part.lower + offset) * scale);
    box.upper = glm::max(box.upper, (part.upper + offset) * scale);
  }
  return box;
}

/// True if an instance has moved and nothing else.
bool Labeller::keeps_box(u32 row) const {
  const ObjectFrame &now = made_.frames[row], &then = before_->frames[row];
  if (!now.rigid || !then.rigid || now.scale != then.scale) return false;
  return std::ranges::all_of(instances()[row].entities, [&](u32 entity) {
    const u32 slot = structure().slot_of_entity[entity];
    return slot != kNone &&
           same_bytes(made_.root_from_entity[slot], before_->root_from_entity[slot]) &&
           made_.meshes[made_.slots[slot].mesh] == before_->meshes[before_->slots[slot].mesh];
  });
}

}  // namespace

Expected<LabelFrames> make_labels(const LabelSources& sources, const Interrupt& interrupt) {
  Labeller labeller(sources);
  labeller.roots();
  labeller.frames(interrupt);
  HELIO_TRY(interrupt.status());
  return labeller.take();
}

std::vector<kernels::RestBoxView> rest_box_views(const Snapshot& snapshot,
                                                 const Placement& placement,
                                                 const LabelFrames& labels) {
  const Structure& structure = *placement.structure;
  /// own   the box of what has no row
  const auto view_of = [&](u32 row, const Box& own, const mat4x3& root_from_entity) {
    if (row == kNone) return rest_box_view({own.lower, own.upper}, mat4x3(1));
    const mat3 map = object_from_root(labels.frames[row],
                                      placement.world[structure.labelling.instances[row].root]);
    return rest_box_view(labels.boxes[row],
                         multiply({map[0], map[1], map[2], vec3(0)}, root_from_entity));
  };
  const u32 slots = placement.slots.size();
  std::vector<kernels::RestBoxView> views(slots + structure.volumes.size());
  parallel_ranges(slots, kRows, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i)
      views[i] =
          view_of(structure.slots[i].row, placement.mesh(i).rest, labels.root_from_entity[i]);
  });
  for (u32 i = 0; i < structure.volumes.size(); ++i) {
    const auto& [entity, row] = structure.volumes[i];
    Box own;
    for (const vec3& corner : box_corners(density(snapshot, entity))) own.extend(corner);
    const u32 root = row == kNone ? entity : structure.labelling.instances[row].root;
    views[slots + i] = view_of(row, own, from_root(snapshot, placement, entity, root));
  }
  return views;
}

}  // namespace heliograph::resident
