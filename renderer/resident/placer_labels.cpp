// Frames and boxes of labels.

#include <algorithm>

#include "renderer/resident/parallel.h"
#include "renderer/resident/placer.h"
#include "renderer/resident/rest_box.h"

namespace heliograph::resident {

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
    const u32 slot = made_->structure->slot_of_entity[entity];
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
    const Box part = builder_.rest_bounds(*made_->meshes[made_->mesh_of_slot[slot]],
                                          from_root_map * mat3(to_root));
    const vec3 offset = from_root_map * to_root[3];
    box.lower = glm::min(box.lower, (part.lower + offset) * scale);
    box.upper = glm::max(box.upper, (part.upper + offset) * scale);
  }
  return box;
}

Status Placer::label_frames() {
  const Structure& structure = *made_->structure;
  made_->root_from_entity.resize(structure.slots.size());
  made_->frames.resize(structure.labelling.instances.size());
  made_->boxes.resize(made_->frames.size());
  constexpr u32 kGrain = 64;
  parallel_ranges(u32(made_->frames.size()), kGrain, [&](u32 begin, u32 end) {
    for (u32 row = begin; row < end && !interrupt_.requested(); ++row) label_row(row);
  });
  return interrupt_.status();
}

void Placer::label_row(u32 row) {
  const Structure& structure = *made_->structure;
  const Instance& instance = structure.labelling.instances[row];
  const bool same_structure = before_ && before_->structure == made_->structure;
  bool moved = !same_structure || !same(made_->world[instance.root], before_->world[instance.root]);
  for (const u32 entity : instance.entities) {
    const u32 slot = structure.slot_of_entity[entity];
    moved |= slot == kNone || moved_[slot] != 0;  // volumes have no slot
  }
  for (const u32 entity : instance.entities) {
    const u32 slot = structure.slot_of_entity[entity];
    if (slot == kNone) continue;
    made_->root_from_entity[slot] =
        moved ? scaled(from_root(entity, instance.root), structure.slots[slot].scale)
              : before_->root_from_entity[slot];
    moved_[slot] |= u8(moved);
  }
  made_->frames[row] = moved ? object_frame(made_->world[instance.root]) : before_->frames[row];
  made_->boxes[row] = !moved || (same_structure && keeps_box(row))
                          ? before_->boxes[row]
                          : rest_box(instance, made_->frames[row]);
}

/// Whether an instance of the same structure has moved and nothing else.
bool Placer::keeps_box(u32 row) const {
  const ObjectFrame &now = made_->frames[row], &then = before_->frames[row];
  if (!now.rigid || !then.rigid || now.scale != then.scale) return false;
  return std::ranges::all_of(made_->structure->labelling.instances[row].entities, [&](u32 entity) {
    const u32 slot = made_->structure->slot_of_entity[entity];
    return slot != kNone && same(made_->root_from_entity[slot], before_->root_from_entity[slot]) &&
           made_->meshes[made_->mesh_of_slot[slot]] == before_->meshes[before_->mesh_of_slot[slot]];
  });
}

void Placer::boxes() {
  const Structure& structure = *made_->structure;
  const bool same_structure = before_ && before_->structure == made_->structure;
  parallel_ranges(u32(structure.slots.size()), kSlotGrain, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i) {
      if (!moved_[i] && same_structure) continue;
      const Box& own = made_->meshes[made_->mesh_of_slot[i]]->rest;
      set_rest_box({own.lower, own.upper}, structure.slots[i].row, made_->root_from_entity[i],
                   made_->instances[i]);
    }
  });
}

/// box   of the rest vertices, which serves an entity that has no row
void Placer::set_rest_box(RestBox box, u32 row, const mat4x3& root_from_entity,
                          kernels::InstanceView& view) const {
  mat4x3 to_object(1);
  if (row != kNone) {
    const mat3 scale = object_from_root(
        made_->frames[row], made_->world[made_->structure->labelling.instances[row].root]);
    box = made_->boxes[row];
    to_object = multiply(mat4x3(scale[0], scale[1], scale[2], vec3(0)), root_from_entity);
  }
  show_rest_box(box, to_object, view);
}

}  // namespace heliograph::resident
