// Poses to instances. Only what moved is made anew; the top level is always built from scratch, so
// that it is a function of its instances alone.
#include "renderer/backend/embree/placement.h"

#include <tbb/parallel_for.h>

#include <cstring>

#include "renderer/backend/embree/commit.h"
#include "renderer/backend/embree/rest_box.h"
#include "renderer/scene/grid.h"

namespace heliograph::embree {
namespace {

// A few large objects are found sooner through a top level of their boxes (9 of W1: by 15 %).
constexpr u32 kFewestStatic = 32;

bool same(const mat4x3& a, const mat4x3& b) { return std::memcmp(&a, &b, sizeof a) == 0; }

mat4x3 scaled(const mat4x3& m, vec3 scale) {
  return {m[0] * scale.x, m[1] * scale.y, m[2] * scale.z, m[3]};
}

bool invertible(const mat4x3& m) {
  const float det = glm::determinant(mat3(m));
  return std::isfinite(det) && det != 0 && std::isfinite(m[3].x + m[3].y + m[3].z);
}

/// The rays that meet an entity: those it says, and those that the kernels ask about.
u32 ray_mask(const Entity& entity) {
  u32 mask = entity.visibility;
  if (mask & kernels::kCameraRay) mask |= kernels::kThroughRay;
  if (!entity.shadow_catcher) return mask;
  if (mask & kernels::kShadowRay) mask |= kernels::kCatcherRay;
  return mask & ~u32(kernels::kCameraRay);
}

/// Makes a Placement step by step.
class Placer {
 public:
  Placer(const Snapshot& snapshot, Time time, std::shared_ptr<const Structure> structure,
         const Placement* before, const PlacementContext& context)
      : snapshot_(snapshot),
        time_(time),
        before_(before),
        builder_(context.builder),
        device_(context.device),
        static_triangles_(context.static_triangles),
        interrupt_(context.interrupt) {
    made_->structure = std::move(structure);
    made_->world = world_poses(snapshot, time);
  }

  Status meshes();
  void choose_static();
  Status instances();
  Status group();
  Status label_frames();
  void boxes();
  void volumes();
  Status top_level();
  void measure();
  std::shared_ptr<Placement> take() { return std::move(made_); }

 private:
  [[nodiscard]] u32 slot_before(const Slot& slot) const;
  [[nodiscard]] bool takes_over(u32 slot, u32 old) const;
  void place(u32 slot);
  /// Looks at the interrupt in every so many of a long loop's turns.
  [[nodiscard]] Status pause(u32 turn) const {
    constexpr u32 kTurns = 1024;
    return turn % kTurns == 0 ? interrupt_.status() : Status{};
  }
  [[nodiscard]] mat4x3 from_root(u32 entity, u32 root) const;
  [[nodiscard]] RestBox rest_box(const Instance& row, const ObjectFrame& frame) const;
  [[nodiscard]] const Grid& density(u32 entity) const {
    return *snapshot_.find(snapshot_.entities.at(entity).volume)->value->density;
  }
  void set_rest_box(RestBox own, u32 row, const mat4x3& root_from_entity,
                    kernels::InstanceView& view) const;

  const Snapshot& snapshot_;
  const Time time_;
  const Placement* before_;
  const MeshBuilder& builder_;
  const RTCDevice device_;
  const u64 static_triangles_;
  const Interrupt& interrupt_;
  std::shared_ptr<Placement> made_ = std::make_shared<Placement>();
  std::vector<u8> moved_;    // by slot
  std::vector<u8> grouped_;  // by slot
  bool changed_ = false;     // the top level differs from the one before
};

Status Placer::meshes() {
  const Structure& structure = *made_->structure;
  made_->meshes = structure.meshes;
  made_->mesh_of_slot.reserve(structure.slots.size());
  const bool between = snapshot_.previous && time_ != snapshot_.time;
  for (const Slot& slot : structure.slots) {
    made_->mesh_of_slot.push_back(slot.mesh);
    if (!slot.deforms && !between) continue;
    HELIO_TRY(interrupt_.status());
    auto deformed = deform(snapshot_, slot.entity, time_, made_->world);
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

u32 Placer::slot_before(const Slot& slot) const {
  if (!before_ || slot.entity >= before_->structure->slot_of_entity.size()) return kNone;
  return before_->structure->slot_of_entity[slot.entity];
}

bool Placer::takes_over(u32 slot, u32 old) const {
  if (old == kNone) return false;
  const u32 entity = made_->structure->slots[slot].entity;
  return same(made_->world[entity], before_->world[entity]) &&
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
  const bool usable = invertible(world);
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
  rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, &view.world_from_object);
  rtcCommitGeometry(geometry);
}

/// Static entities join the group in the order of their slots as long as there is room.
void Placer::choose_static() {
  const Structure& structure = *made_->structure;
  grouped_.assign(structure.slots.size(), 0);
  u64 triangles = 0;
  u32 members = 0;
  for (u32 i = 0; i < structure.slots.size(); ++i) {
    const Slot& slot = structure.slots[i];
    if (!snapshot_.entities.at(slot.entity).is_static || slot.deforms) continue;
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
  }
  if (const RTCError error = rtcGetDeviceError(device_); error != RTC_ERROR_NONE)
    return fail(Code::kResourceExhausted, "", "Embree could not place the scene's instances");
  return {};
}

mat4x3 Placer::from_root(u32 entity, u32 root) const {
  mat4x3 result(1);
  for (u32 i = entity; i != root;) {
    const EntityId parent = snapshot_.entities.at(i).parent;
    if (!parent) return multiply(inverse(made_->world[root]), made_->world[entity]);
    result = multiply(local_pose(snapshot_, i, time_), result);
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
  const bool same_structure = before_ && before_->structure == made_->structure;
  for (u32 row = 0; row < made_->frames.size(); ++row) {
    HELIO_TRY(pause(row));
    const Instance& instance = structure.labelling.instances[row];
    bool moved =
        !same_structure || !same(made_->world[instance.root], before_->world[instance.root]);
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
    if (moved) {
      made_->frames[row] = object_frame(made_->world[instance.root]);
      made_->boxes[row] = rest_box(instance, made_->frames[row]);
    } else {
      made_->frames[row] = before_->frames[row];
      made_->boxes[row] = before_->boxes[row];
    }
  }
  return {};
}

void Placer::boxes() {
  const Structure& structure = *made_->structure;
  for (u32 i = 0; i < structure.slots.size(); ++i) {
    const Slot& slot = structure.slots[i];
    const bool kept = !moved_[i] && before_ && before_->structure == made_->structure;
    if (kept) continue;
    const Box& own = made_->meshes[made_->mesh_of_slot[i]]->rest;
    set_rest_box({own.lower, own.upper}, slot.row, made_->root_from_entity[i], made_->instances[i]);
  }
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

}  // namespace

mat4x3 Placement::mesh_pose(u32 slot) const {
  const Slot& s = structure->slots[slot];
  return scaled(world[s.entity], s.scale);
}

Expected<std::shared_ptr<const Placement>> make_placement(
    const Snapshot& snapshot, Time time, std::shared_ptr<const Structure> structure,
    const Placement* before, const PlacementContext& context) {
  Placer placer(snapshot, time, std::move(structure), before, context);
  HELIO_TRY(placer.meshes());
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
