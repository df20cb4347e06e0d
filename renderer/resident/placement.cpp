// Poses to instances. Only what moved is made anew.
#include "renderer/resident/placement.h"

#include <algorithm>
#include <cstring>
#include <map>

#include "renderer/resident/parallel.h"
#include "renderer/resident/placer.h"
#include "renderer/scene/grid.h"

namespace heliograph::resident {
namespace {

/// The rays that meet an entity: those it says, and those that the kernels ask about.
u32 ray_mask(const Entity& entity) {
  u32 mask = entity.visibility;
  if (mask & kernels::kCameraRay) mask |= kernels::kThroughRay;
  if (!entity.shadow_catcher) return mask;
  if (mask & kernels::kShadowRay) mask |= kernels::kCatcherRay;
  return mask & ~u32(kernels::kCameraRay);
}

/// Whether the pose has an inverse.
bool usable_key(const kernels::MotionKey& key) {
  const float det = key.xx * key.yy * key.zz;
  const vec3& t = key.translation;
  return std::isfinite(det) && det != 0 && std::isfinite(t.x + t.y + t.z);
}

/// Whether they are the same bits.
bool same_keys(std::span<const kernels::MotionKey> a, std::span<const kernels::MotionKey> b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

}  // namespace

Status Placer::meshes() {
  const Structure& structure = *made_->structure;
  made_->meshes = structure.meshes;
  made_->mesh_of_slot.reserve(structure.slots.size());
  const bool between = snapshot_.previous && span_ != TimeSpan{snapshot_.time, snapshot_.time};
  std::map<Time, std::vector<mat4x3>> worlds;
  const WorldAt world_at = [&](Time time) -> const std::vector<mat4x3>& {
    if (time == span_.middle()) return made_->world;
    auto& world = worlds[time];
    if (world.empty()) world = world_poses(snapshot_, time);
    return world;
  };
  for (const Slot& slot : structure.slots) {
    made_->mesh_of_slot.push_back(slot.mesh);
    if (!slot.deforms && !between) continue;
    HELIO_TRY(interrupt_.status());
    auto deformed = deform_within(snapshot_, slot.entity, span_, world_at);
    if (!deformed) continue;
    const Entity& entity = snapshot_.entities.at(slot.entity);
    auto mesh =
        builder_.build(*snapshot_.meshes.at(entity.mesh.index()).value, *std::move(deformed));
    if (!mesh) return std::unexpected(std::move(mesh).error());
    made_->mesh_of_slot.back() = u32(made_->meshes.size());
    made_->meshes.push_back(*std::move(mesh));
  }
  return {};
}

void Placer::motion() {
  const auto& slots = made_->structure->slots;
  keys_.resize(slots.size());
  if (span_.instant()) return;
  parallel_for(slots.size(), [&](std::size_t i) {
    const Box& rest = made_->meshes[made_->mesh_of_slot[i]]->rest;
    keys_[i] = instance_keys(snapshot_, slots[i].entity, span_,
                             {.scale = slots[i].scale, .lower = rest.lower, .upper = rest.upper});
  });
}

void Placer::add_keys(kernels::InstanceView& view, const std::vector<kernels::MotionKey>& keys) {
  view.segments = keys.empty() ? 0 : u32(keys.size() - 1);
  view.first_key = u32(made_->motion_keys.size());
  made_->motion_keys.insert(made_->motion_keys.end(), keys.begin(), keys.end());
}

u32 Placer::slot_before(const Slot& slot) const {
  if (!before_ || slot.entity >= before_->structure->slot_of_entity.size()) return kNone;
  return before_->structure->slot_of_entity[slot.entity];
}

bool Placer::takes_over(u32 slot, u32 old) const {
  if (old == kNone) return false;
  const u32 entity = made_->structure->slots[slot].entity;
  return same(made_->world[entity], before_->world[entity]) &&
         same_keys(keys_[slot], before_->keys_of(old)) &&
         made_->structure->slots[slot].scale == before_->structure->slots[old].scale &&
         made_->meshes[made_->mesh_of_slot[slot]]->accelerator ==
             before_->meshes[before_->mesh_of_slot[old]]->accelerator &&
         ray_mask(snapshot_.entities.at(entity)) == before_->instances[old].visibility;
}

void Placer::place(u32 index) {
  const Slot& slot = made_->structure->slots[index];
  kernels::InstanceView& view = made_->instances[index];
  const mat4x3 world = made_->mesh_pose(index);
  const bool usable = usable_pose(world) && std::ranges::all_of(keys_[index], usable_key);
  view.world_from_object = usable ? world : mat4x3(1);
  view.object_from_world = usable ? inverse(world) : mat4x3(1);
  const Entity& entity = snapshot_.entities.at(slot.entity);
  view.visibility = usable ? ray_mask(entity) : 0;
  const bool flipped = glm::determinant(mat3(view.world_from_object)) < 0;
  view.flags =
      (flipped ? u32(kernels::kFlipped) : 0) | (entity.shadow_catcher ? u32(kernels::kCatcher) : 0);
}

void Placer::instances() {
  const u32 count = u32(made_->structure->slots.size());
  made_->instances.resize(count);
  kept_.assign(count, kNone);
  moved_.assign(count, 0);
  parallel_ranges(count, kSlotGrain, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i) instance(i);
  });
  for (u32 i = 0; i < count; ++i) add_keys(made_->instances[i], keys_[i]);
}

/// All but its keys.
void Placer::instance(u32 index) {
  const Structure& structure = *made_->structure;
  const Slot& slot = structure.slots[index];
  const u32 old = slot_before(slot);
  kernels::InstanceView& view = made_->instances[index];
  if (takes_over(index, old)) {
    view = before_->instances[old];
    view.flags &= u32(kernels::kFlipped) | u32(kernels::kCatcher);
    kept_[index] = old;
  } else {
    place(index);
    moved_[index] = 1;
  }
  const EntityLabel& label = structure.labelling.entities[slot.entity];
  view.mesh = made_->mesh_of_slot[index];
  view.first_part = slot.first_part;
  view.entity = slot.entity;
  view.label = label.instance;
  view.category = label.category;
  view.part = label.part;
}

/// Volumes are instances that rays do not find.
void Placer::volumes() {
  const Structure& structure = *made_->structure;
  for (const auto& [entity, row] : structure.volumes) {
    kernels::InstanceView& view = made_->volumes.emplace_back();
    const mat4x3& world = made_->world[entity];
    const bool usable = usable_pose(world);
    view.world_from_object = usable ? world : mat4x3(1);
    view.object_from_world = usable ? inverse(world) : mat4x3(1);
    view.visibility = usable ? snapshot_.entities.at(entity).visibility : 0;
    view.mesh = kNone;
    view.entity = entity;
    const EntityLabel& label = structure.labelling.entities[entity];
    view.label = label.instance;
    view.category = label.category;
    view.part = label.part;
    RestBox own;
    for (const vec3& corner : box_corners(density(entity))) {
      own.lower = glm::min(own.lower, corner);
      own.upper = glm::max(own.upper, corner);
      made_->bounds.extend(view.world_from_object * vec4(corner, 1));
    }
    add_keys(view, instance_keys(snapshot_, entity, span_,
                                 {.scale = vec3(1), .lower = own.lower, .upper = own.upper}));
    const u32 root = row == kNone ? entity : structure.labelling.instances[row].root;
    set_rest_box(own, row, from_root(entity, root), view);
  }
}

Status Placer::accelerate() {
  if (made_->instances.empty()) return {};
  auto made = accelerator_.build(snapshot_, *made_, {before_, kept_}, interrupt_);
  if (!made) return std::unexpected(std::move(made).error());
  made_->accelerator = *std::move(made);
  made_->bounds = made_->accelerator->bounds();
  return {};
}

std::span<const kernels::MotionKey> Placement::keys_of(u32 slot) const {
  const kernels::InstanceView& view = instances[slot];
  return std::span(motion_keys).subspan(view.first_key, view.segments > 0 ? view.segments + 1 : 0);
}

mat4x3 Placement::mesh_pose(u32 slot) const {
  const Slot& s = structure->slots[slot];
  return scaled(world[s.entity], s.scale);
}

Expected<std::shared_ptr<const Placement>> make_placement(
    const Snapshot& snapshot, const TimeSpan& span, std::shared_ptr<const Structure> structure,
    const Placement* before, const PlacementContext& context) {
  Placer placer(snapshot, span, std::move(structure), before, context);
  HELIO_TRY(placer.meshes());
  placer.motion();
  HELIO_TRY(context.interrupt.status());
  placer.instances();
  HELIO_TRY(placer.label_frames());
  placer.boxes();
  HELIO_TRY(placer.accelerate());
  placer.volumes();
  return placer.take();
}

}  // namespace heliograph::resident
