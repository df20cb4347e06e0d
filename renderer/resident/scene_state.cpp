// Pieces to what the kernels read. Declared in scene_state.h and scene.h.
#include <algorithm>

#include "renderer/derived/black_body.h"
#include "renderer/resident/scene.h"

namespace heliograph::resident {
namespace {

/// Bytes of the chunks that another array, or null, does not share.
template <class T>
u64 bytes_of(const ChunkedArray<T>& rows, const ChunkedArray<T>* other) {
  u64 bytes = 0;
  for (u32 c = 0; c < rows.chunk_count(); ++c)
    if (!other || !rows.shares(c, *other)) bytes += rows.chunk(c).size_bytes();
  return bytes;
}

}  // namespace

SceneState::SceneState(std::shared_ptr<const Snapshot> snapshot, const TimeSpan& span,
                       ScenePieces pieces)
    : snapshot_(std::move(snapshot)), span_(span), pieces_(std::move(pieces)) {
  const auto& [placement, volumes, materials, surfaces, lights] = pieces_;
  const Structure& structure = *placement->structure;
  for (const auto& mesh : placement->meshes) meshes_.push_back(mesh->view());
  view_ = surfaces->all;
  view_.any_holes = surfaces->holes != nullptr;
  view_.any_curves = std::ranges::any_of(
      meshes_, [](const auto& mesh) { return mesh.shape == kernels::Shape::kCurves; });
  view_.plain_rays =
      !view_.any_holes && !view_.any_curves && placement->moving.empty() &&
      std::ranges::all_of(meshes_, [](const auto& mesh) { return mesh.segments == 0; });
  view_.meshes = meshes_.data();
  view_.materials = materials->materials.data();
  view_.textures = materials->textures.data();
  view_.texture_uses = materials->uses.data();
  view_.part_materials = structure.part_materials.data();
  view_.part_lights = lights->part_lights ? lights->part_lights->data() : nullptr;
  view_.lights = lights->lights.data();
  view_.motion_keys = placement->motion_keys.data();
  view_.light_nodes = lights->tree->nodes.data();
  volumes_ = volumes->views;
  for (std::size_t i = 0; i < volumes_.size(); ++i)
    volumes_[i].instance.light_group = structure.group_of_volume[i];
  view_.volumes = volumes_.data();
  view_.volume_count = u32(volumes_.size());
  view_.volume_nodes = volumes->nodes.data();
  view_.black_body = black_body_table().data();
  view_.dome = lights->dome;
  view_.suns = lights->suns.data();
  view_.sun_count = u32(lights->suns.size());
  view_.sky_power = lights->sky_power;
  casters_ = find_casters(*placement, *materials, surfaces->focusing, *lights);
  view_.casters = casters_.casters.data();
  view_.caster_count = u32(casters_.casters.size());
  view_.cast_lights = casters_.lights.data();
  view_.cast_light_count = u32(casters_.lights.size());
  view_.caster_probability = casters_.probability;
  view_.instance_count = placement->slots.size();
  view_.light_count = u32(lights->lights.size());
  view_.flat_triangles = lights->flat_triangles.data();
  view_.only_even = std::ranges::all_of(lights->lights, [](const kernels::LightView& light) {
    return light.sphere_radius > 0 || light.flat != kernels::kNone;
  });
  const Box& bounds = placement->bounds;
  view_.center = bounds.empty() ? vec3(0) : 0.5f * (bounds.lower + bounds.upper);
  view_.radius = bounds.empty() ? 1 : 0.5f * glm::length(bounds.upper - bounds.lower);
}

u64 SceneState::bytes_beside(const SceneState* other) const {
  constexpr u64 kTopBytesPerInstance = 256;  // nodes and instance of a top level
  constexpr u64 kTopBytesPerKey = 128;       // the same of a time step
  const Placement& own = placement();
  const Placement* theirs = other ? &other->placement() : nullptr;
  const auto shared = [&](auto field) { return theirs ? &(theirs->*field) : nullptr; };
  const bool same_top = theirs && theirs->accelerator == own.accelerator;
  const u64 static_bytes =
      own.accelerator
          ? own.accelerator->static_bytes_beside(theirs ? theirs->accelerator.get() : nullptr)
          : 0;
  // Instances and labels count whether somebody has asked for them or not.
  constexpr u64 kLateBytesPerRow =
      sizeof(kernels::InstanceView) + sizeof(mat4x3) + sizeof(ObjectFrame) + sizeof(RestBox);
  const u64 world_bytes = bytes_of(own.world, shared(&Placement::world));
  return bytes_of(own.slots, shared(&Placement::slots)) + world_bytes +
         world_bytes / sizeof(mat4x3) * kLateBytesPerRow +
         (same_top ? 0 : own.slots.size() * kTopBytesPerInstance + static_bytes) +
         own.motion_keys.size() * (sizeof(kernels::MotionKey) + kTopBytesPerKey) +
         meshes_.size() * sizeof(kernels::MeshView) +
         pieces_.materials->materials.size() * sizeof(kernels::MaterialView);
}

bool same_poses(const SceneState& scene, const Snapshot& snapshot, const TimeSpan& span) {
  const Snapshot& before = scene.snapshot();
  return scene.span() == span && before.time == snapshot.time &&
         before.entities.same(snapshot.entities) && before.meshes.same(snapshot.meshes) &&
         before.poses.same(snapshot.poses) &&
         (span == TimeSpan{snapshot.time, snapshot.time} || before.previous == snapshot.previous);
}

bool same_materials(const Snapshot& a, const Snapshot& b) {
  return a.materials.same(b.materials) && a.textures.same(b.textures);
}

bool same_assets(const Snapshot& a, const Snapshot& b) {
  return a.meshes.same(b.meshes) && a.volumes.same(b.volumes) && a.dome == b.dome &&
         same_materials(a, b);
}

Expected<std::span<const kernels::RestBoxView>> ResidentScene::rest_boxes(
    const Interrupt& interrupt) const {
  auto made = rest_boxes_.get([&]() -> Expected<std::vector<kernels::RestBoxView>> {
    const auto frames = labels(interrupt);
    if (!frames) return std::unexpected(frames.error());
    return rest_box_views(snapshot(), placement(), **frames);
  });
  if (!made) return std::unexpected(std::move(made).error());
  return std::span(**made);
}

const kernels::SceneView& ResidentScene::view() const {
  std::call_once(made_, [&] {
    view_ = state_->view();
    run_alone([&] { instances_ = flat_.copy(placement().instances()); });
    view_.instances = instances_.get();
  });
  return view_;
}

}  // namespace heliograph::resident
