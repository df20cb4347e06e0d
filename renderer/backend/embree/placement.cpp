// Poses to instances. Only what moved is made anew; the top level is always built from scratch, so
// that it is a function of its instances alone.
#include "renderer/backend/embree/placement.h"

#include <algorithm>
#include <cstring>
#include <map>

#include "renderer/backend/embree/commit.h"
#include "renderer/backend/embree/instance_motion.h"
#include "renderer/backend/embree/parallel.h"
#include "renderer/backend/embree/placer.h"
#include "renderer/scene/grid.h"

namespace heliograph::embree {
namespace {

// A few large objects are found sooner through a top level of their boxes (9 of W1: by 15 %).
constexpr u32 kFewestStatic = 32;

/// The rays that meet an entity: those it says, and those that the kernels ask about.
u32 ray_mask(const Entity& entity) {
  u32 mask = entity.visibility;
  if (mask & kernels::kCameraRay) mask |= kernels::kThroughRay;
  if (!entity.shadow_catcher) return mask;
  if (mask & kernels::kShadowRay) mask |= kernels::kCatcherRay;
  return mask & ~u32(kernels::kCameraRay);
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
         grouped_[slot] == !before_->geometries[old] &&
         made_->meshes[made_->mesh_of_slot[slot]]->blas ==
             before_->meshes[before_->mesh_of_slot[old]]->blas &&
         ray_mask(snapshot_.entities.at(entity)) == before_->instances[old].visibility;
}

void Placer::place(u32 index) {
  const Slot& slot = made_->structure->slots[index];
  kernels::InstanceView& view = made_->instances[index];
  const mat4x3 world = made_->mesh_pose(index);
  const bool usable = invertible(world) && std::ranges::all_of(keys_[index], usable_key);
  view.world_from_object = usable ? world : mat4x3(1);
  view.object_from_world = usable ? inverse(world) : mat4x3(1);
  const Entity& entity = snapshot_.entities.at(slot.entity);
  view.visibility = ray_mask(entity);
  const bool flipped = glm::determinant(mat3(view.world_from_object)) < 0;
  view.flags =
      (flipped ? u32(kernels::kFlipped) : 0) | (entity.shadow_catcher ? u32(kernels::kCatcher) : 0);

  made_->geometries[index] = {};
  if (grouped_[index]) return;
  made_->geometries[index] = GeometryHandle(rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE));
  const RTCGeometry geometry = made_->geometries[index].get();
  rtcSetGeometryInstancedScene(geometry, made_->instance_scenes[index]);
  rtcSetGeometryMask(geometry, usable ? view.visibility : 0);
  if (keys_[index].empty())
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, &view.world_from_object);
  else
    set_motion(geometry, keys_[index]);
  rtcCommitGeometry(geometry);
}

/// Static entities join the group in the order of their slots as long as there is room; those that
/// move in the span stay outside.
void Placer::choose_static() {
  const Structure& structure = *made_->structure;
  grouped_.assign(structure.slots.size(), 0);
  u64 triangles = 0;
  u32 members = 0;
  for (u32 i = 0; i < structure.slots.size(); ++i) {
    const Slot& slot = structure.slots[i];
    if (!snapshot_.entities.at(slot.entity).is_static || slot.deforms) continue;
    if (!keys_[i].empty() || made_->meshes[made_->mesh_of_slot[i]]->segments > 0) continue;
    if (!invertible(made_->world[slot.entity])) continue;
    const DeviceMesh& mesh = *made_->meshes[made_->mesh_of_slot[i]];
    if (mesh.shape() != kernels::Shape::kTriangles) continue;
    const u64 more = mesh.topology->triangles.size();
    if (triangles + more > static_triangles_) continue;
    triangles += more;
    ++members;
    grouped_[i] = 1;
  }
  if (members < kFewestStatic) grouped_.assign(grouped_.size(), 0);
}

Status Placer::group() {
  std::vector<StaticMember> members;
  for (u32 i = 0; i < grouped_.size(); ++i) {
    if (!grouped_[i]) continue;
    members.push_back({i, made_->instances[i].visibility, made_->meshes[made_->mesh_of_slot[i]],
                       made_->instances[i].world_from_object});
  }
  auto made = make_static_group(std::move(members), before_ ? before_->group : nullptr, device_,
                                interrupt_);
  if (!made) return std::unexpected(std::move(made).error());
  made_->group = *std::move(made);
  return {};
}

Status Placer::instances() {
  const Structure& structure = *made_->structure;
  const u32 count = u32(structure.slots.size());
  made_->instances.resize(count);
  made_->geometries.resize(count);
  made_->instance_scenes.resize(count);
  moved_.assign(count, 0);
  changed_ = !before_ || before_->instances.size() != count;
  for (u32 i = 0; i < count; ++i) {
    HELIO_TRY(pause(i));
    const Slot& slot = structure.slots[i];
    made_->instance_scenes[i] = made_->meshes[made_->mesh_of_slot[i]]->blas->scene.get();
    const u32 old = slot_before(slot);
    kernels::InstanceView& view = made_->instances[i];
    if (takes_over(i, old)) {
      view = before_->instances[old];
      view.flags &= u32(kernels::kFlipped) | u32(kernels::kCatcher);
      made_->geometries[i] = before_->geometries[old];
      changed_ |= old != i;
    } else {
      place(i);
      moved_[i] = 1;
      changed_ = true;
    }
    const EntityLabel& label = structure.labelling.entities[slot.entity];
    view.mesh = made_->mesh_of_slot[i];
    view.first_part = slot.first_part;
    view.entity = slot.entity;
    view.label = label.instance;
    view.category = label.category;
    view.part = label.part;
    add_keys(view, keys_[i]);
  }
  if (const RTCError error = rtcGetDeviceError(device_); error != RTC_ERROR_NONE)
    return fail(Code::kResourceExhausted, "", "Embree could not place the scene's instances");
  return {};
}

/// Volumes are instances that rays do not find.
void Placer::volumes() {
  const Structure& structure = *made_->structure;
  for (const auto& [entity, row] : structure.volumes) {
    kernels::InstanceView& view = made_->volumes.emplace_back();
    const mat4x3& world = made_->world[entity];
    const bool usable = invertible(world);
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

Status Placer::top_level() {
  if (made_->geometries.empty()) return {};
  if (!changed_) {
    made_->top = before_->top;
    measure();
    return {};
  }
  made_->top = new_scene(device_);
  for (u32 i = 0; i < made_->geometries.size(); ++i)
    if (made_->geometries[i])
      rtcAttachGeometryByID(made_->top.get(), made_->geometries[i].get(), i);
  if (made_->group)
    rtcAttachGeometryByID(made_->top.get(), made_->group->instance.get(),
                          u32(made_->geometries.size()));
  HELIO_TRY(commit(made_->top.get(), device_, interrupt_));
  measure();
  return {};
}

void Placer::measure() {
  RTCBounds bounds;
  rtcGetSceneBounds(made_->top.get(), &bounds);
  made_->bounds.lower = {bounds.lower_x, bounds.lower_y, bounds.lower_z};
  made_->bounds.upper = {bounds.upper_x, bounds.upper_y, bounds.upper_z};
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
  placer.choose_static();
  HELIO_TRY(placer.instances());
  HELIO_TRY(placer.group());
  HELIO_TRY(placer.label_frames());
  placer.boxes();
  HELIO_TRY(placer.top_level());
  placer.volumes();
  return placer.take();
}

}  // namespace heliograph::embree
