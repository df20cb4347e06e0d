// Poses to instances. Only what changed is made anew.
#include "renderer/resident/placement.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <numeric>

#include "kernels/motion.h"
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

/// Whether rays that begin within kernels::kReach are nowhere farther than kFarthest in an object's
/// frame.
bool is_within_reach(const mat4x3& object_from_world) {
  for (int row = 0; row < 3; ++row) {
    float most = std::abs(object_from_world[3][row]);
    for (int axis = 0; axis < 3; ++axis)
      most += std::abs(object_from_world[axis][row]) * kernels::kReach;
    if (!(most < kernels::kFarthest)) return false;
  }
  return true;
}
bool is_within_reach(const kernels::MotionKey& key) {
  return is_within_reach(kernels::inverse_of(kernels::interpolate(key, key, 0)));
}

/// Whether they are the same bits.
bool same_keys(std::span<const kernels::MotionKey> a, std::span<const kernels::MotionKey> b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

constexpr u32 kRows = ChunkedArray<u32>::kRows;

void in_vertex_pieces(std::size_t count, const std::function<void(std::size_t, std::size_t)>& f) {
  constexpr std::size_t kVertices = 4096;  // of a piece; few at a time stay near
  parallel_ranges(count, kVertices, f);
}

}  // namespace

Placer::Placer(const Moment& now, Placeable what, const PlacedBefore* before,
               const PlacementContext& context)
    : snapshot_(now.snapshot),
      span_(now.span),
      then_(before ? &before->snapshot : nullptr),
      before_(before && before->placement.structure == what.structure ? &before->placement
                                                                      : nullptr),
      all_(!before_),
      builder_(context.builder),
      accelerator_(context.accelerator),
      interrupt_(context.interrupt) {
  made_->span = now.span;
  made_->structure = std::move(what.structure);
  made_->holes = std::move(what.holes);
}

void Placer::worlds() {
  const u32 capacity = snapshot_.entities.capacity();
  const Moment now{snapshot_, span_};
  ChunkedArray<mat4x3>& world = made_->world;
  if (before_) {
    entities_ =
        with_descendants(structure(), changed_entities({*then_, before_->span}, now, structure()));
    changed_.resize(capacity);
    for (const u32 entity : entities_) changed_[entity] = 1;
    world = before_->world;
  } else {
    snapshot_.entities.for_each([&](u32 index, const Entity&) { entities_.push_back(index); });
    world = ChunkedArray<mat4x3>::unwritten(capacity);
    parallel_for(world.chunk_count(),
                 [&](u32 c) { std::ranges::fill(world.write_chunk(c), mat4x3(1)); });
  }
  if (!structure().children.of.empty()) return write_worlds_downwards();
  for_each_chunk(entities_, [&](u32 c, std::span<const u32> entities) {
    const auto rows = world.write_chunk(c);
    for (const u32 i : entities) rows[i % kRows] = local_pose(snapshot_, i, span_.middle());
  });
}

/// Each after its parent.
void Placer::write_worlds_downwards() {
  ChunkedArray<mat4x3>& world = made_->world;
  std::vector<u8> done(snapshot_.entities.capacity());
  std::vector<u32> chain;
  const auto parent_of = [&](u32 entity) { return snapshot_.entities.at(entity).parent; };
  for (const u32 entity : entities_) {
    for (u32 i = entity; !done[i];) {
      chain.push_back(i);
      const EntityId parent = parent_of(i);
      if (!parent || !is_changed(parent.index())) break;
      i = parent.index();
    }
    for (; !chain.empty(); chain.pop_back()) {
      const u32 i = chain.back();
      const mat4x3 local = local_pose(snapshot_, i, span_.middle());
      const EntityId parent = parent_of(i);
      world.write(i) = parent ? multiply(world[parent.index()], local) : local;
      done[i] = 1;
    }
  }
}

Status Placer::meshes() {
  made_->meshes = structure().meshes;
  made_->mesh_of_slot = structure().mesh_of_slot;
  std::map<Time, std::vector<mat4x3>> worlds;
  const auto poses = [&](Time time) -> const std::vector<mat4x3>& {
    auto& world = worlds[time];
    if (world.empty()) world = world_poses(snapshot_, time);
    return world;
  };
  const WorldAt world_at{.poses = poses, .in_pieces = in_vertex_pieces};
  for (const u32 index : deforming_slots({snapshot_, span_}, structure())) {
    HELIO_TRY(interrupt_.status());
    const Slot& slot = structure().slots[index];
    auto deformed = deform_within(snapshot_, slot.entity, span_, world_at);
    if (!deformed) continue;
    const Entity& entity = snapshot_.entities.at(slot.entity);
    auto mesh =
        builder_.build(*snapshot_.meshes.at(entity.mesh.index()).value, *std::move(deformed));
    if (!mesh) return std::unexpected(std::move(mesh).error());
    made_->mesh_of_slot.write(index) = u32(made_->meshes.size());
    made_->meshes.push_back(*std::move(mesh));
    made_->deformed.push_back(index);
  }
  return {};
}

void Placer::motion() {
  if (span_.instant()) return;
  const std::vector<u32> slots = slots_of(
      structure(), with_descendants(structure(), moving_entities({snapshot_, span_}, structure())));
  std::vector<std::vector<kernels::MotionKey>> keys(slots.size());
  parallel_for(slots.size(), [&](std::size_t i) {
    const Slot& slot = structure().slots[slots[i]];
    const Box& rest = made_->meshes[made_->mesh_of_slot[slots[i]]]->rest;
    keys[i] = instance_keys(snapshot_, slot.entity, span_,
                            {.scale = slot.scale, .lower = rest.lower, .upper = rest.upper});
  });
  for (std::size_t i = 0; i < slots.size(); ++i) {
    if (keys[i].empty()) continue;
    made_->moving.push_back(slots[i]);
    first_keys_.push_back(u32(made_->motion_keys.size()));
    made_->motion_keys.insert(made_->motion_keys.end(), keys[i].begin(), keys[i].end());
  }
  first_keys_.push_back(u32(made_->motion_keys.size()));
}

/// What moves or deforms is always made anew: its keys and its mesh are.
void Placer::find_slots() {
  if (all_) {
    slots_.resize(structure().slots.size());
    std::iota(slots_.begin(), slots_.end(), 0u);
    return;
  }
  slots_ = slots_of(structure(), entities_);
  for (const Placement* placement : {before_, static_cast<const Placement*>(made_.get())}) {
    merge(slots_, placement->moving);
    merge(slots_, placement->deformed);
  }
  if (made_->holes == before_->holes) return;
  const auto is_hole = [](const HoleSlots& holes, u32 slot) { return holes && (*holes)[slot]; };
  std::vector<u32> differ;
  for (u32 i = 0; i < structure().slots.size(); ++i)
    if (is_hole(made_->holes, i) != is_hole(before_->holes, i)) differ.push_back(i);
  merge(slots_, std::move(differ));
}

void Placer::instances() {
  made_->instances =
      before_ ? before_->instances
              : ChunkedArray<kernels::InstanceView>::unwritten(u32(structure().slots.size()));
  for_each_chunk(slots_, [&](u32 c, std::span<const u32> slots) {
    const auto rows = made_->instances.write_chunk(c);
    for (const u32 i : slots) rows[i % kRows] = instance(i);
  });
}

kernels::InstanceView Placer::instance(u32 index) const {
  const Slot& slot = structure().slots[index];
  kernels::InstanceView view{};
  place(view, index);
  view.mesh = made_->mesh_of_slot[index];
  view.first_part = slot.first_part;
  view.entity = slot.entity;
  const EntityLabel& label = structure().labelling.entities[slot.entity];
  view.label = label.instance;
  view.category = label.category;
  view.part = label.part;
  view.light_group = structure().group_of_slot[index];
  const Box& own = made_->meshes[view.mesh]->rest;
  set_rest_box({own.lower, own.upper}, slot.row, made_->root_from_entity[index], view);
  return view;
}

void Placer::place(kernels::InstanceView& view, u32 index) const {
  const Entity& entity = snapshot_.entities.at(structure().slots[index].entity);
  std::span<const kernels::MotionKey> keys;
  const auto moving = std::ranges::lower_bound(made_->moving, index);
  if (moving != made_->moving.end() && *moving == index) {
    const u32* first = &first_keys_[std::size_t(moving - made_->moving.begin())];
    keys = std::span(made_->motion_keys).subspan(first[0], first[1] - first[0]);
    view.first_key = first[0];
    view.segments = u32(keys.size() - 1);
  }
  const mat4x3 world = made_->mesh_pose(index);
  const bool usable = usable_pose(world) && std::ranges::all_of(keys, usable_key);
  view.world_from_object = usable ? world : mat4x3(1);
  view.object_from_world = usable ? inverse(world) : mat4x3(1);
  const bool within_reach =
      keys.empty() ? is_within_reach(view.object_from_world)
                   : std::ranges::all_of(
                         keys, [](const kernels::MotionKey& key) { return is_within_reach(key); });
  view.visibility = usable && within_reach ? ray_mask(entity) : 0;
  if (glm::determinant(mat3(view.world_from_object)) < 0) view.flags |= kernels::kFlipped;
  if (entity.shadow_catcher) view.flags |= kernels::kCatcher;
  if (entity.label.part != 0) view.flags |= kernels::kOnePart;
  if (made_->holes && (*made_->holes)[index]) view.flags |= kernels::kMayBeHole;
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
    const auto keys = instance_keys(snapshot_, entity, span_,
                                    {.scale = vec3(1), .lower = own.lower, .upper = own.upper});
    view.segments = keys.empty() ? 0 : u32(keys.size() - 1);
    view.first_key = u32(made_->motion_keys.size());
    made_->motion_keys.insert(made_->motion_keys.end(), keys.begin(), keys.end());
    const u32 root = row == kNone ? entity : structure.labelling.instances[row].root;
    set_rest_box(own, row, from_root(entity, root), view);
  }
}

Status Placer::accelerate(const Placement* before) {
  if (made_->instances.size() == 0) return {};
  if (before_ && made_->instances.same(before_->instances)) {
    made_->accelerator = before_->accelerator;
  } else {
    auto made = accelerator_.build(snapshot_, *made_, {before}, interrupt_);
    if (!made) return std::unexpected(std::move(made).error());
    made_->accelerator = *std::move(made);
  }
  made_->bounds = made_->accelerator->bounds();
  return {};
}

bool Kept::chunk(const Placement& now, u32 chunk) const {
  return before && before->structure == now.structure &&
         now.instances.shares(chunk, before->instances);
}

u32 Kept::slot(const Placement& now, u32 slot) const {
  if (!before) return kNone;
  u32 old = slot;
  if (before->structure != now.structure) {
    const u32 entity = now.structure->slots[slot].entity;
    const auto& slots = before->structure->slot_of_entity;
    old = entity < slots.size() ? slots[entity] : kNone;
    if (old == kNone) return kNone;
  }
  const kernels::InstanceView &a = now.instances[slot], &b = before->instances[old];
  const bool same = a.visibility == b.visibility &&
                    same_bytes(a.world_from_object, b.world_from_object) &&
                    same_keys(now.keys_of(slot), before->keys_of(old)) &&
                    now.meshes[a.mesh]->accelerator == before->meshes[b.mesh]->accelerator;
  return same ? old : kNone;
}

std::span<const kernels::MotionKey> Placement::keys_of(u32 slot) const {
  const kernels::InstanceView& view = instances[slot];
  return std::span(motion_keys).subspan(view.first_key, view.segments > 0 ? view.segments + 1 : 0);
}

mat4x3 Placement::mesh_pose(u32 slot) const {
  const Slot& s = structure->slots[slot];
  return scaled(world[s.entity], s.scale);
}

Expected<std::shared_ptr<const Placement>> make_placement(const Moment& moment, Placeable what,
                                                          const PlacedBefore* before,
                                                          const PlacementContext& context) {
  Placer placer(moment, std::move(what), before, context);
  placer.worlds();
  HELIO_TRY(placer.meshes());
  placer.motion();
  HELIO_TRY(context.interrupt.status());
  placer.find_slots();
  HELIO_TRY(placer.label_frames());
  placer.instances();
  HELIO_TRY(placer.accelerate(before ? &before->placement : nullptr));
  placer.volumes();
  return placer.take();
}

}  // namespace heliograph::resident
