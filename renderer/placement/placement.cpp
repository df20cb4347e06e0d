// Poses to placements. Only what changed is made anew.
#include "renderer/placement/placement.h"

#include <algorithm>
#include <map>
#include <numeric>

#include "renderer/base/parallel.h"
#include "renderer/scene/grid.h"

namespace heliograph::resident {
namespace {

/// The rays that meet an entity: those it states, and those that the kernels ask about.
u32 ray_mask(const Entity& entity) {
  u32 mask = entity.visibility;
  if (mask & kernels::kCameraRay) mask |= kernels::kThroughRay;
  if (!entity.shadow_catcher) return mask;
  if (mask & kernels::kShadowRay) mask |= kernels::kCatcherRay;
  return mask & ~u32(kernels::kCameraRay);
}

constexpr u32 kRows = ChunkedArray<u32>::kRows;

void in_vertex_pieces(std::size_t count, const std::function<void(std::size_t, std::size_t)>& f) {
  constexpr std::size_t kVertices = 4096;  // of a piece; few at a time stay near
  parallel_ranges(count, kVertices, f);
}

}  // namespace

/// Makes a placement, its steps in this order. Of an earlier one of the same structure only what
/// may have changed is made anew; without one, everything.
class Placer {
 public:
  Placer(const Moment& now, Placeable what, const PlacedBefore* before,
         const PlacementContext& context);

  void worlds();
  Status meshes();
  void motion();
  void slots();
  Status accelerate(const Placement* before);
  void volumes();
  void remember();
  std::shared_ptr<Placement> take() { return std::move(made_); }

 private:
  [[nodiscard]] const Structure& structure() const { return *made_->structure; }
  [[nodiscard]] Moment now() const { return {snapshot_, span_}; }
  [[nodiscard]] bool are_worlds_given() const;
  void find_changed();
  void write_worlds_downwards();
  [[nodiscard]] std::vector<u32> slots_to_make() const;
  [[nodiscard]] kernels::SlotView slot(u32 index) const;

  const Snapshot& snapshot_;
  const TimeSpan span_;
  const Snapshot* then_ = nullptr;       // of before_
  const Placement* before_ = nullptr;    // of the same structure, or null
  const LabelFrames* labels_ = nullptr;  // of before_, if they were made when this one began
  const MeshBuilder& builder_;
  const Accelerator& accelerator_;
  const Interrupt& interrupt_;
  std::shared_ptr<Placement> made_ = std::make_shared<Placement>();
  // Entities that changed, or that something above them did; ascending. Where worlds are given only
  // labels need them.
  std::vector<u32> entities_;
  std::vector<u32> first_keys_;  // of Placement::moving, and where the last ones end
};

Placer::Placer(const Moment& now, Placeable what, const PlacedBefore* before,
               const PlacementContext& context)
    : snapshot_(now.snapshot),
      span_(now.span),
      then_(before ? &before->snapshot : nullptr),
      before_(before && before->placement.structure == what.structure ? &before->placement
                                                                      : nullptr),
      builder_(context.builder),
      accelerator_(context.accelerator),
      interrupt_(context.interrupt) {
  if (before_) labels_ = before_->labels_.made();
  made_->span = now.span;
  made_->structure = std::move(what.structure);
  made_->holes = std::move(what.holes);
}

/// True if all entities are where Snapshot::poses has them, in the world.
bool Placer::are_worlds_given() const {
  if (!structure().children.of.empty()) return false;
  for (u32 c = 0; c < snapshot_.poses.chunk_count(); ++c)
    if (!has_plain_poses(now(), c)) return false;
  return true;
}

void Placer::find_changed() {
  if (before_)
    entities_ = with_descendants(structure(),
                                 changed_entities({*then_, before_->span}, now(), structure()));
  else
    snapshot_.entities.for_each([&](u32 index, const Entity&) { entities_.push_back(index); });
}

void Placer::worlds() {
  ChunkedArray<mat4x3>& world = made_->world;
  const bool are_given = are_worlds_given();
  if (!are_given || labels_) find_changed();
  if (are_given) {
    world = snapshot_.poses;
    return;
  }
  if (before_) {
    world = before_->world;
  } else {
    world = ChunkedArray<mat4x3>::unwritten(snapshot_.entities.capacity());
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
  std::vector<u8> waits(snapshot_.entities.capacity());
  for (const u32 entity : entities_) waits[entity] = 1;
  std::vector<u32> chain;
  for (const u32 entity : entities_) {
    for (u32 i = entity; waits[i];) {
      chain.push_back(i);
      waits[i] = 0;
      const EntityId parent = snapshot_.entities.at(i).parent;
      if (!parent) break;
      i = parent.index();
    }
    for (; !chain.empty(); chain.pop_back()) {
      const u32 i = chain.back();
      const mat4x3 local = local_pose(snapshot_, i, span_.middle());
      const EntityId parent = snapshot_.entities.at(i).parent;
      world.write(i) = parent ? multiply(world[parent.index()], local) : local;
    }
  }
}

Status Placer::meshes() {
  made_->meshes = structure().meshes;
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
    const Box& rest = structure().meshes[slot.mesh]->rest;
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

/// Slots to make: what moves or deforms is always made anew, as its keys and its mesh are.
std::vector<u32> Placer::slots_to_make() const {
  std::vector<u32> slots;
  if (!before_) {
    slots.resize(structure().slots.size());
    std::iota(slots.begin(), slots.end(), 0u);
    return slots;
  }
  slots = slots_of(structure(), entities_with_other_rows(*then_, snapshot_));
  for (const Placement* placement : {before_, static_cast<const Placement*>(made_.get())}) {
    merge(slots, placement->moving);
    merge(slots, placement->deformed);
  }
  if (made_->holes == before_->holes) return slots;
  const auto is_hole = [](const HoleSlots& holes, u32 slot) { return holes && (*holes)[slot]; };
  std::vector<u32> differ;
  for (u32 i = 0; i < structure().slots.size(); ++i)
    if (is_hole(made_->holes, i) != is_hole(before_->holes, i)) differ.push_back(i);
  merge(slots, std::move(differ));
  return slots;
}

void Placer::slots() {
  made_->slots = before_
                     ? before_->slots
                     : ChunkedArray<kernels::SlotView>::unwritten(u32(structure().slots.size()));
  for_each_chunk(slots_to_make(), [&](u32 c, std::span<const u32> slots) {
    const auto rows = made_->slots.write_chunk(c);
    for (const u32 i : slots) rows[i % kRows] = slot(i);
  });
}

kernels::SlotView Placer::slot(u32 index) const {
  const Slot& slot = structure().slots[index];
  const Entity& entity = snapshot_.entities.at(slot.entity);
  const EntityLabel& label = structure().labelling.entities[slot.entity];
  kernels::SlotView view{.mesh = slot.mesh,
                         .first_part = slot.first_part,
                         .flags = 0,
                         .visibility = ray_mask(entity),
                         .entity = slot.entity,
                         .label = label.instance,
                         .category = label.category,
                         .part = label.part,
                         .segments = 0,
                         .first_key = 0,
                         .light_group = structure().group_of_slot[index],
                         .scale = slot.scale};
  const auto deformed = std::ranges::lower_bound(made_->deformed, index);
  if (deformed != made_->deformed.end() && *deformed == index)
    view.mesh = u32(structure().meshes.size() + std::size_t(deformed - made_->deformed.begin()));
  const auto moving = std::ranges::lower_bound(made_->moving, index);
  if (moving != made_->moving.end() && *moving == index) {
    const u32* first = &first_keys_[std::size_t(moving - made_->moving.begin())];
    view.first_key = first[0];
    view.segments = first[1] - first[0] - 1;
  }
  if (entity.shadow_catcher) view.flags |= kernels::kCatcher;
  if (entity.label.part != 0) view.flags |= kernels::kOnePart;
  if (made_->holes && (*made_->holes)[index]) view.flags |= kernels::kMayBeHole;
  return view;
}

/// Volumes are instances that rays do not find.
void Placer::volumes() {
  const Structure& structure = *made_->structure;
  for (const auto& [entity, row] : structure.volumes) {
    kernels::InstanceView& view = made_->volumes.emplace_back();
    const mat4x3& world = made_->world[entity];
    const bool usable = kernels::usable_pose(world);
    view.world_from_object = usable ? world : mat4x3(1);
    view.object_from_world = usable ? inverse(world) : mat4x3(1);
    view.visibility = usable ? snapshot_.entities.at(entity).visibility : 0;
    view.mesh = kNone;
    view.entity = entity;
    const EntityLabel& label = structure.labelling.entities[entity];
    view.label = label.instance;
    view.category = label.category;
    view.part = label.part;
    Box own;
    const Volume& volume = *snapshot_.find(snapshot_.entities.at(entity).volume)->value;
    for (const vec3& corner : box_corners(*volume.density)) {
      own.extend(corner);
      made_->bounds.extend(view.world_from_object * vec4(corner, 1));
    }
    const auto keys = instance_keys(snapshot_, entity, span_,
                                    {.scale = vec3(1), .lower = own.lower, .upper = own.upper});
    view.segments = keys.empty() ? 0 : u32(keys.size() - 1);
    view.first_key = u32(made_->motion_keys.size());
    made_->motion_keys.insert(made_->motion_keys.end(), keys.begin(), keys.end());
  }
}

Status Placer::accelerate(const Placement* before) {
  const Kept kept{before};
  const u32 chunks = made_->slots.chunk_count();
  if (chunks == 0) return {};
  bool stays = before_ != nullptr;
  for (u32 c = 0; stays && c < chunks; ++c) stays = kept.chunk(*made_, c);
  if (stays) {
    made_->accelerator = before_->accelerator;
  } else {
    auto made = accelerator_.build(snapshot_, *made_, kept, interrupt_);
    if (!made) return std::unexpected(std::move(made).error());
    made_->accelerator = *std::move(made);
  }
  made_->bounds = made_->accelerator->bounds();
  return {};
}

/// Remembers what the earlier one had made late, as what this one makes then begins with it.
void Placer::remember() {
  if (!before_) return;
  if (const auto* rows = before_->instances_.made()) {
    auto& earlier = made_->instances_before_.emplace(*rows);
    for (u32 c = 0; c < rows->chunk_count(); ++c)
      earlier.stay.push_back(u8(Kept{before_}.chunk(*made_, c)));
  }
  if (labels_) {
    made_->labels_before_ = {*labels_, std::move(entities_), before_->deformed};
    merge(made_->labels_before_.deformed, made_->deformed);
  }
}

std::span<const kernels::MotionKey> Placement::keys_of(u32 slot) const {
  const kernels::SlotView& view = slots[slot];
  return std::span(motion_keys).subspan(view.first_key, view.segments > 0 ? view.segments + 1 : 0);
}

mat4x3 Placement::mesh_pose(u32 slot) const {
  const kernels::SlotView& view = slots[slot];
  return kernels::scaled(world[view.entity], view.scale);
}

kernels::InstanceView Placement::instance(u32 slot) const {
  return kernels::placed(slots[slot], world[slots[slot].entity], motion_keys.data());
}

const ChunkedArray<kernels::InstanceView>& Placement::instances() const {
  return **instances_.get([&]() -> Expected<ChunkedArray<kernels::InstanceView>> {
    auto made = ChunkedArray<kernels::InstanceView>::unwritten(slots.size());
    parallel_for(made.chunk_count(), [&](u32 c) {
      if (instances_before_ && instances_before_->stay[c])
        return made.share_chunk(c, instances_before_->rows);
      u32 next = c * kRows;
      for (kernels::InstanceView& row : made.write_chunk(c)) row = instance(next++);
    });
    instances_before_.reset();
    return made;
  });
}

Expected<const LabelFrames*> Placement::labels(const Snapshot& snapshot, const MeshBuilder& builder,
                                               const Interrupt& interrupt) const {
  return labels_.get([&] {
    auto made = make_labels({snapshot, *this, builder, labels_before_}, interrupt);
    if (made) labels_before_ = {};
    return made;
  });
}

Expected<std::shared_ptr<const Placement>> make_placement(const Moment& moment, Placeable what,
                                                          const PlacedBefore* before,
                                                          const PlacementContext& context) {
  Placer placer(moment, std::move(what), before, context);
  placer.worlds();
  HELIO_TRY(placer.meshes());
  placer.motion();
  HELIO_TRY(context.interrupt.status());
  placer.slots();
  HELIO_TRY(placer.accelerate(before ? &before->placement : nullptr));
  placer.volumes();
  placer.remember();
  return placer.take();
}

}  // namespace heliograph::resident
