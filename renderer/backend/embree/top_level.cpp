// The top level is always built from scratch, so that it is a function of its instances alone.
#include "renderer/backend/embree/top_level.h"

#include <algorithm>

#include "renderer/backend/embree/commit.h"
#include "renderer/backend/embree/mesh.h"

namespace heliograph::embree {
namespace {

// A few large objects are found sooner through a top level of their boxes (9 of W1: by 15 %).
constexpr u32 kFewestStatic = 32;

/// Gives an instance its keys as time steps; Embree interpolates them as kernels::interpolate()
/// does.
void set_motion(RTCGeometry instance, std::span<const kernels::MotionKey> keys) {
  rtcSetGeometryTimeStepCount(instance, unsigned(keys.size()));
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const kernels::MotionKey& key = keys[i];
    RTCQuaternionDecomposition step;
    rtcInitQuaternionDecomposition(&step);
    rtcQuaternionDecompositionSetScale(&step, key.xx, key.yy, key.zz);
    rtcQuaternionDecompositionSetSkew(&step, key.xy, key.xz, key.yz);
    rtcQuaternionDecompositionSetQuaternion(&step, key.rotation.w, key.rotation.x, key.rotation.y,
                                            key.rotation.z);
    rtcQuaternionDecompositionSetTranslation(&step, key.translation.x, key.translation.y,
                                             key.translation.z);
    rtcSetGeometryTransformQuaternion(instance, unsigned(i), &step);
  }
}

const TopLevel* top_of(const Placement* placement) {
  return placement ? static_cast<const TopLevel*>(placement->accelerator.get()) : nullptr;
}

class Builder {
 public:
  Builder(const Placement& placement, const Kept& kept, RTCDevice device,
          const Interrupt& interrupt)
      : placement_(placement),
        kept_(kept),
        before_(top_of(kept.before)),
        device_(device),
        interrupt_(interrupt) {}

  void choose_static(const Snapshot& snapshot, u64 most_triangles);
  Status instances();
  Status group();
  Status scene();
  std::shared_ptr<TopLevel> take() { return std::move(made_); }

 private:
  [[nodiscard]] GeometryHandle instance(u32 slot) const;

  const Placement& placement_;
  const Kept& kept_;
  const TopLevel* before_;
  const RTCDevice device_;
  const Interrupt& interrupt_;
  std::shared_ptr<TopLevel> made_ = std::make_shared<TopLevel>();
  std::vector<u8> grouped_;  // by slot
  bool changed_ = false;     // the scene differs from the one before
};

/// Static entities join the group in the order of their slots as long as there is room; those that
/// move in the span stay outside.
void Builder::choose_static(const Snapshot& snapshot, u64 most_triangles) {
  const auto& slots = placement_.structure->slots;
  grouped_.assign(slots.size(), 0);
  u64 triangles = 0;
  u32 members = 0;
  for (u32 i = 0; i < slots.size(); ++i) {
    if (!snapshot.entities.at(slots[i].entity).is_static || slots[i].deforms) continue;
    const DeviceMesh& mesh = *placement_.meshes[placement_.mesh_of_slot[i]];
    if (placement_.instances[i].segments > 0 || mesh.segments > 0) continue;
    if (!usable_pose(placement_.world[slots[i].entity])) continue;
    if (mesh.shape() != kernels::Shape::kTriangles) continue;
    const u64 more = mesh.topology->triangles.size();
    if (triangles + more > most_triangles) continue;
    triangles += more;
    ++members;
    grouped_[i] = 1;
  }
  if (members < kFewestStatic) grouped_.assign(grouped_.size(), 0);
}

GeometryHandle Builder::instance(u32 slot) const {
  GeometryHandle handle(rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE));
  const RTCGeometry geometry = handle.get();
  const kernels::InstanceView& view = placement_.instances[slot];
  rtcSetGeometryInstancedScene(geometry, made_->instance_scenes[slot]);
  rtcSetGeometryMask(geometry, view.visibility);
  if (view.segments == 0)
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, &view.world_from_object);
  else
    set_motion(geometry, placement_.keys_of(slot));
  rtcCommitGeometry(geometry);
  return handle;
}

Status Builder::instances() {
  constexpr u32 kTurns = 1024;  // between looks at the interrupt
  const u32 count = u32(placement_.instances.size());
  made_->geometries.resize(count);
  changed_ = !before_ || before_->geometries.size() != count;
  for (u32 i = 0; i < count; ++i) {
    if (i % kTurns == 0) HELIO_TRY(interrupt_.status());
    made_->instance_scenes.push_back(scene_of(*placement_.meshes[placement_.mesh_of_slot[i]]));
    const u32 old = before_ ? kept_.slots[i] : kNone;
    changed_ |= old != i || bool(before_->geometries[old]) == bool(grouped_[i]);
    if (grouped_[i]) continue;
    const bool reused = old != kNone && before_->geometries[old];
    made_->geometries[i] = reused ? before_->geometries[old] : instance(i);
  }
  if (const RTCError error = rtcGetDeviceError(device_); error != RTC_ERROR_NONE)
    return fail(Code::kResourceExhausted, "", "Embree could not place the scene's instances");
  return {};
}

Status Builder::group() {
  std::vector<StaticMember> members;
  for (u32 i = 0; i < grouped_.size(); ++i) {
    if (!grouped_[i]) continue;
    const kernels::InstanceView& view = placement_.instances[i];
    members.push_back({i, view.visibility, placement_.meshes[placement_.mesh_of_slot[i]],
                       view.world_from_object});
  }
  auto made = make_static_group(std::move(members), before_ ? before_->group : nullptr, device_,
                                interrupt_);
  if (!made) return std::unexpected(std::move(made).error());
  made_->group = *std::move(made);
  return {};
}

Status Builder::scene() {
  if (!changed_) {
    made_->scene = before_->scene;
    return {};
  }
  made_->scene = new_scene(device_);
  for (u32 i = 0; i < made_->geometries.size(); ++i)
    if (made_->geometries[i])
      rtcAttachGeometryByID(made_->scene.get(), made_->geometries[i].get(), i);
  if (made_->group)
    rtcAttachGeometryByID(made_->scene.get(), made_->group->instance.get(),
                          u32(made_->geometries.size()));
  return commit(made_->scene.get(), device_, interrupt_);
}

}  // namespace

Box TopLevel::bounds() const { return bounds_of(scene.get()); }

Expected<std::shared_ptr<const MeshAccelerator>> EmbreeAccelerator::build(
    const DeviceMesh& mesh) const {
  return build_mesh(mesh, device_);
}

Expected<std::shared_ptr<const SceneAccelerator>> EmbreeAccelerator::build(
    const Snapshot& snapshot, const Placement& placement, const Kept& kept,
    const Interrupt& interrupt) const {
  Builder builder(placement, kept, device_, interrupt);
  builder.choose_static(snapshot, static_triangles_);
  HELIO_TRY(builder.instances());
  HELIO_TRY(builder.group());
  HELIO_TRY(builder.scene());
  return builder.take();
}

TracedScene traced(const Placement& placement, const kernels::SceneView& view) {
  const TopLevel* top = top_of(&placement);
  if (!top) return {.view = &view};
  TracedScene traced{
      .top = top->scene.get(), .instance_scenes = top->instance_scenes.data(), .view = &view};
  if (const StaticGroup* group = top->group.get()) {
    traced.group = u32(placement.instances.size());
    traced.group_instances = group->slots.data();
  }
  return traced;
}

}  // namespace heliograph::embree
