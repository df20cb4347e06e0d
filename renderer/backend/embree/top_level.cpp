// The top level is always built from scratch, so that it is a function of its instances alone.
#include "renderer/backend/embree/top_level.h"

#include <algorithm>
#include <atomic>

#include "kernels/bvh/bvh_box.h"
#include "renderer/backend/embree/commit.h"
#include "renderer/backend/embree/mesh.h"
#include "renderer/base/parallel.h"

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

/// Where rays look for an instance: the box about its turned box, and the one about its turned
/// vertices.
Box ray_box(const kernels::InstanceView& instance, const EmbreeMesh& mesh, const Box& own) {
  const kernels::BvhBox loose = kernels::ray_box(instance, nullptr, {own.lower, own.upper});
  if (loose.empty() || mesh.support.is_empty()) return {loose.lower, loose.upper};
  const Box tight = mesh.support.under(instance.world_from_object);
  return {glm::max(loose.lower, tight.lower), glm::min(loose.upper, tight.upper)};
}

template <class T>
bool same_rows(const std::vector<T>& a, const std::vector<T>& b) {
  return std::ranges::equal(a, b, same_bytes<T>);
}
bool same(const InstanceChunk& a, const InstanceChunk& b) {
  return same_bytes(a.bounds, b.bounds) && same_rows(a.still.instances, b.still.instances) &&
         same_rows(a.still.boxes, b.still.boxes) &&
         std::ranges::equal(a.moving, b.moving, {}, &GeometryHandle::get, &GeometryHandle::get);
}

/// True if rays meet none of it.
bool is_empty(const std::shared_ptr<const InstanceChunk>& chunk) {
  return std::ranges::all_of(chunk->still.boxes, &Box::empty) &&
         std::ranges::none_of(chunk->moving, &GeometryHandle::get);
}

class Builder {
 public:
  Builder(const Placement& placement, const Kept& kept, RTCDevice device,
          const Interrupt& interrupt)
      : placement_(placement),
        kept_(kept),
        before_(top_of(kept.before)),
        instances_(placement.instances()),
        device_(device),
        interrupt_(interrupt) {}

  void choose_static(u64 most_triangles);
  Status instances();
  Status group();
  Status scene();
  std::shared_ptr<TopLevel> take() { return std::move(made_); }

 private:
  static constexpr u32 kRows = ChunkedArray<kernels::InstanceView>::kRows;

  [[nodiscard]] GeometryHandle moving(u32 slot) const;
  [[nodiscard]] GeometryHandle moving_before(u32 slot) const;
  [[nodiscard]] bool is_grouped(u32 slot) const { return !grouped_.empty() && grouped_[slot]; }
  [[nodiscard]] std::shared_ptr<const InstanceChunk> chunk(u32 number) const;
  void instance_scenes();

  const Placement& placement_;
  const Kept& kept_;
  const TopLevel* before_;
  const ChunkedArray<kernels::InstanceView>& instances_;
  const RTCDevice device_;
  const Interrupt& interrupt_;
  std::shared_ptr<TopLevel> made_ = std::make_shared<TopLevel>();
  std::vector<StaticMember> members_;  // of the group, until it is made
  std::vector<u8> grouped_;            // by slot, whether it is one; empty: there are none
};

void Builder::choose_static(u64 most_triangles) {
  members_ = static_members(placement_, most_triangles);
  if (members_.empty()) return;
  grouped_.assign(placement_.slots.size(), 0);
  for (const StaticMember& member : members_) grouped_[member.slot] = 1;
}

/// An instance of Embree's own, whose boxes are right between its keys, too.
GeometryHandle Builder::moving(u32 slot) const {
  if (GeometryHandle before = moving_before(slot)) return before;
  GeometryHandle handle(rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE));
  rtcSetGeometryInstancedScene(handle.get(), (*made_->instance_scenes)[slot]);
  rtcSetGeometryMask(handle.get(), instances_[slot].visibility);
  set_motion(handle.get(), placement_.keys_of(slot));
  rtcCommitGeometry(handle.get());
  return handle;
}
GeometryHandle Builder::moving_before(u32 slot) const {
  const u32 old = before_ ? kept_.slot(placement_, slot) : kNone;
  return old == kNone ? GeometryHandle() : before_->chunks[old / kRows]->moving[old % kRows];
}

void Builder::instance_scenes() {
  const Placement* before = kept_.before;
  if (before_ && before->slots.same(placement_.slots) && before->meshes == placement_.meshes) {
    made_->instance_scenes = before_->instance_scenes;
    return;
  }
  std::vector<RTCScene> scenes(placement_.slots.size());
  for (u32 i = 0; i < scenes.size(); ++i) scenes[i] = embree_mesh(placement_.mesh(i)).scene.get();
  made_->instance_scenes = std::make_shared<const std::vector<RTCScene>>(std::move(scenes));
}

std::shared_ptr<const InstanceChunk> Builder::chunk(u32 number) const {
  auto made = std::make_shared<InstanceChunk>();
  const u32 begin = number * kRows, end = std::min(begin + kRows, placement_.slots.size());
  made->still.instances.resize(end - begin);
  made->still.boxes.resize(end - begin);
  made->moving.resize(end - begin);
  for (u32 i = begin; i < end; ++i) {
    const kernels::InstanceView& instance = instances_[i];
    const EmbreeMesh& mesh = embree_mesh(placement_.mesh(i));
    const Box own = mesh.bounds();
    const kernels::BvhBox box =
        kernels::instance_box(instance, placement_.motion_keys.data(), {own.lower, own.upper});
    made->bounds.extend(Box{box.lower, box.upper});
    if (is_grouped(i)) continue;
    if (instance.segments > 0) {
      made->moving[i - begin] = moving(i);
      continue;
    }
    made->still.instances[i - begin] = {instance.object_from_world, mesh.scene.get(), i,
                                        instance.visibility};
    made->still.boxes[i - begin] = ray_box(instance, mesh, own);
  }
  const bool is_kept =
      before_ && number < before_->chunks.size() && same(*made, *before_->chunks[number]);
  if (is_kept) return before_->chunks[number];
  make_geometry(made->still, device_);
  return made;
}

Status Builder::instances() {
  instance_scenes();
  HELIO_TRY(interrupt_.status());
  made_->chunks.resize(instances_.chunk_count());
  // Without groups a chunk of the same slots has the same instances.
  const bool by_chunks = before_ && members_.empty() && !before_->group;
  std::atomic<bool> failed = false;
  parallel_for(made_->chunks.size(), [&](std::size_t c) {
    const bool is_kept = by_chunks && kept_.chunk(placement_, u32(c));
    made_->chunks[c] = is_kept ? before_->chunks[c] : chunk(u32(c));
    if (rtcGetDeviceError(device_) != RTC_ERROR_NONE) failed = true;  // the thread's
  });
  HELIO_TRY(interrupt_.status());
  if (failed)
    return fail(Code::kResourceExhausted, "", "Embree could not place the scene's instances");
  return {};
}

Status Builder::group() {
  auto made = make_static_group(std::move(members_), before_ ? before_->group : nullptr, device_,
                                interrupt_);
  if (!made) return std::unexpected(std::move(made).error());
  made_->group = *std::move(made);
  return {};
}

Status Builder::scene() {
  if (before_ && made_->chunks == before_->chunks && made_->group == before_->group) {
    made_->scene = before_->scene;
    return {};
  }
  if (made_->group && std::ranges::all_of(made_->chunks, is_empty)) {
    made_->scene = made_->group->scene;
    return {};
  }
  made_->scene = new_scene(device_);
  const u32 slots = placement_.slots.size();
  for (u32 c = 0; c < made_->chunks.size(); ++c) {
    const InstanceChunk& chunk = *made_->chunks[c];
    rtcAttachGeometryByID(made_->scene.get(), chunk.still.geometry.get(), slots + c);
    for (u32 i = 0; i < chunk.moving.size(); ++i)
      if (chunk.moving[i])
        rtcAttachGeometryByID(made_->scene.get(), chunk.moving[i].get(), c * kRows + i);
  }
  if (made_->group)
    rtcAttachGeometryByID(made_->scene.get(), made_->group->instance.geometry.get(),
                          slots + u32(made_->chunks.size()));
  return commit(made_->scene.get(), device_, interrupt_);
}

}  // namespace

Box TopLevel::bounds() const {
  Box box;
  for (const auto& chunk : chunks) box.extend(chunk->bounds);
  return box;
}

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
    traced.group_instances = group->slots.data();
  }
  return traced;
}

}  // namespace heliograph::embree
