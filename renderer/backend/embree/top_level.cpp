// The top level is always built from scratch, so that it is a function of its instances alone.
#include "renderer/backend/embree/top_level.h"

#include "renderer/backend/embree/commit.h"
#include "renderer/backend/embree/mesh.h"

namespace heliograph::embree {
namespace {

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

  void choose_static(u64 most_triangles);
  Status instances();
  Status group();
  Status scene();
  std::shared_ptr<TopLevel> take() { return std::move(made_); }

 private:
  [[nodiscard]] GeometryHandle instance(u32 slot) const;
  [[nodiscard]] bool is_grouped(u32 slot) const { return !grouped_.empty() && grouped_[slot]; }
  void instance_scenes();
  void instances_of(u32 chunk);

  const Placement& placement_;
  const Kept& kept_;
  const TopLevel* before_;
  const RTCDevice device_;
  const Interrupt& interrupt_;
  std::shared_ptr<TopLevel> made_ = std::make_shared<TopLevel>();
  std::vector<StaticMember> members_;  // of the group, until it is made
  std::vector<u8> grouped_;            // by slot, whether it is one; empty: there are none
  bool changed_ = false;               // the scene differs from the one before
};

void Builder::choose_static(u64 most_triangles) {
  members_ = static_members(placement_, most_triangles);
  if (members_.empty()) return;
  grouped_.assign(placement_.slots.size(), 0);
  for (const StaticMember& member : members_) grouped_[member.slot] = 1;
}

GeometryHandle Builder::instance(u32 slot) const {
  GeometryHandle handle(rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE));
  const RTCGeometry geometry = handle.get();
  const kernels::InstanceView& view = placement_.instances()[slot];
  rtcSetGeometryInstancedScene(geometry, (*made_->instance_scenes)[slot]);
  rtcSetGeometryMask(geometry, view.visibility);
  if (view.segments == 0)
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, &view.world_from_object);
  else
    set_motion(geometry, placement_.keys_of(slot));
  rtcCommitGeometry(geometry);
  return handle;
}

void Builder::instance_scenes() {
  const Placement* before = kept_.before;
  if (before_ && before->slots.same(placement_.slots) && before->meshes == placement_.meshes) {
    made_->instance_scenes = before_->instance_scenes;
    return;
  }
  std::vector<RTCScene> scenes(placement_.slots.size());
  for (u32 i = 0; i < scenes.size(); ++i) scenes[i] = scene_of(placement_.mesh(i));
  made_->instance_scenes = std::make_shared<const std::vector<RTCScene>>(std::move(scenes));
}

Status Builder::instances() {
  instance_scenes();
  const u32 count = placement_.slots.size();
  changed_ = !before_ || before_->geometries.size() != count;
  // Without groups a chunk of the same instances has the same geometries.
  const bool by_chunks = !changed_ && members_.empty() && !before_->group;
  made_->geometries =
      by_chunks ? before_->geometries : ChunkedArray<GeometryHandle>::unwritten(count);
  for (u32 c = 0; c < made_->geometries.chunk_count(); ++c) {
    HELIO_TRY(interrupt_.status());
    if (!by_chunks || !kept_.chunk(placement_, c)) instances_of(c);
  }
  if (const RTCError error = rtcGetDeviceError(device_); error != RTC_ERROR_NONE)
    return fail(Code::kResourceExhausted, "", "Embree could not place the scene's instances");
  return {};
}

void Builder::instances_of(u32 chunk) {
  const auto geometries = made_->geometries.write_chunk(chunk);
  for (u32 k = 0; k < geometries.size(); ++k) {
    const u32 i = chunk * ChunkedArray<GeometryHandle>::kRows + k;
    const u32 old = before_ ? kept_.slot(placement_, i) : kNone;
    changed_ |= old != i || bool(before_->geometries[old]) == is_grouped(i);
    const bool reused = old != kNone && before_->geometries[old];
    if (is_grouped(i))
      geometries[k] = {};
    else
      geometries[k] = reused ? before_->geometries[old] : instance(i);
  }
}

Status Builder::group() {
  auto made = make_static_group(std::move(members_), before_ ? before_->group : nullptr, device_,
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
  u32 number = 0;
  for (u32 c = 0; c < made_->geometries.chunk_count(); ++c)
    for (const GeometryHandle& geometry : made_->geometries.chunk(c)) {
      if (geometry) rtcAttachGeometryByID(made_->scene.get(), geometry.get(), number);
      ++number;
    }
  if (made_->group)
    rtcAttachGeometryByID(made_->scene.get(), made_->group->instance.get(),
                          u32(made_->geometries.size()));
  return commit(made_->scene.get(), device_, interrupt_);
}

}  // namespace

Box TopLevel::bounds() const { return bounds_of(scene.get()); }

u64 TopLevel::static_bytes_beside(const SceneAccelerator* other) const {
  if (!group) return 0;
  const auto* theirs = static_cast<const TopLevel*>(other);
  const bool is_shared =
      theirs && theirs->group && theirs->group->scene.get() == group->scene.get();
  return is_shared ? 0 : group->bytes();
}

Expected<std::shared_ptr<const MeshAccelerator>> EmbreeAccelerator::build(
    const DeviceMesh& mesh, const Interrupt& interrupt) const {
  return build_mesh(mesh, device_, interrupt);
}

Expected<std::shared_ptr<const SceneAccelerator>> EmbreeAccelerator::build(
    const Snapshot&, const Placement& placement, const Kept& kept,
    const Interrupt& interrupt) const {
  Builder builder(placement, kept, device_, interrupt);
  builder.choose_static(static_triangles_);
  HELIO_TRY(builder.instances());
  HELIO_TRY(builder.group());
  HELIO_TRY(builder.scene());
  return builder.take();
}

TracedScene traced(const Placement& placement, const kernels::SceneView& view) {
  const TopLevel* top = top_of(&placement);
  if (!top) return {.view = &view};
  TracedScene traced{
      .top = top->scene.get(), .instance_scenes = top->instance_scenes->data(), .view = &view};
  if (const StaticGroup* group = top->group.get()) {
    traced.group = u32(placement.slots.size());
    traced.group_instances = group->slots.data();
  }
  return traced;
}

}  // namespace heliograph::embree
