// Snapshots to scenes, by difference from the nearest one kept.
#include "renderer/resident/scene.h"

#include <algorithm>

#include "kernels/material.h"
#include "renderer/resident/black_body.h"
#include "renderer/resident/casters.h"
#include "renderer/resident/parallel.h"

namespace heliograph::resident {
namespace {

constexpr std::size_t kScenesKept = 8;

bool may_be_hole(const kernels::MaterialView& material) {
  return material.alpha_mode != kernels::AlphaMode::kOpaque;
}

/// Whether nothing that decides on poses in a span differs between a scene and a snapshot.
bool same_poses(const ResidentScene& scene, const Snapshot& snapshot, const TimeSpan& span) {
  const Snapshot& before = scene.snapshot();
  return scene.span() == span && before.time == snapshot.time &&
         before.entities.same(snapshot.entities) && before.meshes.same(snapshot.meshes) &&
         before.poses.same(snapshot.poses) &&
         (span == TimeSpan{snapshot.time, snapshot.time} || before.previous == snapshot.previous);
}

bool same_structure(const Snapshot& a, const Snapshot& b) {
  return a.entities.same(b.entities) && a.meshes.same(b.meshes) && a.volumes.same(b.volumes) &&
         a.materials.capacity() == b.materials.capacity() && a.categories == b.categories;
}

bool same_materials(const Snapshot& a, const Snapshot& b) {
  return a.materials.same(b.materials) && a.textures.same(b.textures);
}

/// The grids of the volumes in use.
template <class F>
void for_each_grid(const Snapshot& snapshot, F&& f) {
  snapshot.volumes.for_each([&](u32, const Shared<Volume>& row) {
    if (row.uses == 0) return;
    for (const Grid* grid : grids_of(*row.value)) f(*grid);
  });
}

}  // namespace

ResidentScene::ResidentScene(std::shared_ptr<const Snapshot> snapshot, const TimeSpan& span,
                             ScenePieces pieces)
    : snapshot_(std::move(snapshot)), span_(span), pieces_(std::move(pieces)) {
  const auto& [placement, volumes, materials, lights] = pieces_;
  const Structure& structure = *placement->structure;
  for (std::size_t i = 0; i < placement->meshes.size(); ++i) {
    meshes_.push_back(placement->meshes[i]->view());
  }
  for (const u32 row : structure.part_materials) {
    const kernels::MaterialView& material = materials->materials[row];
    kernels::note_interior(view_, material);
    view_.any_holes |= may_be_hole(material);
  }
  instances_.resize(placement->instances.size());
  constexpr std::size_t kGrain = 256;
  parallel_ranges(instances_.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      instances_[i] = placement->instances[i];
      instances_[i].light_group = lights->group_of_slot[i];
      if (!view_.any_holes) continue;
      const auto parts =
          std::span(structure.part_materials)
              .subspan(structure.slots[i].first_part, meshes_[instances_[i].mesh].part_count);
      if (std::ranges::any_of(parts,
                              [&](u32 row) { return may_be_hole(materials->materials[row]); }))
        instances_[i].flags |= kernels::kMayBeHole;
    }
  });
  view_.instances = instances_.data();
  view_.meshes = meshes_.data();
  view_.materials = materials->materials.data();
  view_.textures = materials->textures.data();
  view_.texture_uses = materials->uses.data();
  view_.part_materials = structure.part_materials.data();
  view_.part_lights = lights->part_lights.data();
  view_.lights = lights->lights.data();
  view_.motion_keys = placement->motion_keys.data();
  view_.light_nodes = lights->tree->nodes.data();
  volumes_ = volumes->views;
  for (std::size_t i = 0; i < volumes_.size(); ++i)
    volumes_[i].instance.light_group = lights->group_of_volume[i];
  view_.volumes = volumes_.data();
  view_.volume_count = u32(volumes_.size());
  view_.black_body = black_body_table().data();
  view_.dome = lights->dome;
  view_.suns = lights->suns.data();
  view_.sun_count = u32(lights->suns.size());
  view_.surface_probability = lights->surface_probability;
  casters_ = find_casters(*placement, *materials);
  view_.casters = casters_.data();
  view_.caster_count = u32(casters_.size());
  if (!casters_.empty()) cast_lights_ = find_cast_lights(*lights, placement->bounds);
  view_.cast_lights = cast_lights_.data();
  view_.cast_light_count = u32(cast_lights_.size());
  view_.caster_probability = caster_probability(*lights);
  view_.instance_count = u32(instances_.size());
  view_.light_count = u32(lights->lights.size());
  const Box& bounds = placement->bounds;
  view_.center = bounds.empty() ? vec3(0) : 0.5f * (bounds.lower + bounds.upper);
  view_.radius = bounds.empty() ? 1 : 0.5f * glm::length(bounds.upper - bounds.lower);
}

u64 ResidentScene::bytes() const {
  constexpr u64 kTopBytesPerInstance = 256;  // nodes and instance of a top level
  constexpr u64 kTopBytesPerKey = 128;       // the same of a time step
  return instances_.size() * (2 * sizeof(kernels::InstanceView) + kTopBytesPerInstance) +
         placement().world.size() * sizeof(mat4x3) +
         placement().motion_keys.size() * (sizeof(kernels::MotionKey) + kTopBytesPerKey) +
         meshes_.size() * sizeof(kernels::MeshView) +
         pieces_.materials->materials.size() * sizeof(kernels::MaterialView);
}

Expected<std::shared_ptr<const ResidentScene>> SceneStore::prepare(
    const std::shared_ptr<const Snapshot>& snapshot, const TimeSpan& span,
    const Interrupt& interrupt) {
  const auto before = nearest(*snapshot, span);
  auto scene = make({snapshot, span}, before, interrupt);
  if (scene && *scene != before) keep(*scene);
  return scene;
}

Expected<DeviceScenes> SceneStore::prepare_all(std::span<const SceneAt> scenes,
                                               const Interrupt& interrupt) {
  if (scenes.empty()) return DeviceScenes();
  const auto before = nearest(*scenes.front().snapshot, scenes.front().span);
  std::vector<Expected<std::shared_ptr<const ResidentScene>>> made(scenes.size());
  parallel_for(scenes.size(), [&](std::size_t i) { made[i] = make(scenes[i], before, interrupt); });
  DeviceScenes all;
  for (auto& scene : made) {
    if (!scene) return std::unexpected(std::move(scene).error());
    all.push_back(*scene);
  }
  if (*made.back() != before) keep(*made.back());
  return all;
}

Expected<std::shared_ptr<const ResidentScene>> SceneStore::make(
    const SceneAt& wanted, const std::shared_ptr<const ResidentScene>& before,
    const Interrupt& interrupt) const {
  const auto& [snapshot, span] = wanted;
  const bool materials_kept = before && same_materials(before->snapshot(), *snapshot);
  std::shared_ptr<const Placement> placement;
  if (before && same_structure(before->snapshot(), *snapshot) &&
      same_poses(*before, *snapshot, span)) {
    placement = before->pieces().placement;
  } else {
    std::shared_ptr<const Structure> structure;
    if (before && same_structure(before->snapshot(), *snapshot)) {
      structure = before->placement().structure;
    } else {
      auto made = make_structure(*snapshot, builder_);
      if (!made) return std::unexpected(std::move(made).error());
      structure = *std::move(made);
    }
    auto made = make_placement(*snapshot, span, std::move(structure),
                               before ? &before->placement() : nullptr,
                               {builder_, accelerator_, interrupt});
    if (!made) return std::unexpected(std::move(made).error());
    placement = *std::move(made);
  }
  HELIO_TRY(interrupt.status());
  const bool placement_kept = before && placement == before->pieces().placement;
  if (placement_kept && materials_kept && before->snapshot().dome == snapshot->dome &&
      before->snapshot().revision == snapshot->revision)
    return before;
  ScenePieces pieces{.placement = std::move(placement)};
  pieces.volumes = placement_kept ? before->pieces().volumes
                                  : make_volumes(*snapshot, *pieces.placement, cache_);
  pieces.materials =
      materials_kept ? before->pieces().materials : make_materials(*snapshot, cache_);
  pieces.lights = placement_kept && materials_kept && before->snapshot().dome == snapshot->dome
                      ? before->pieces().lights
                      : make_lights(*snapshot, *pieces.placement, *pieces.materials,
                                    before ? before->pieces().lights.get() : nullptr, cache_);
  return std::make_shared<const ResidentScene>(snapshot, span, std::move(pieces));
}

bool SceneStore::ready(const Snapshot& snapshot) const {
  bool all = true;
  snapshot.meshes.for_each([&](u32, const Shared<Mesh>& row) {
    all = all &&
          (row.uses == 0 || row.value->topology->triangles.empty() || builder_.ready(*row.value));
  });
  return all;
}

Status SceneStore::warm(const Snapshot& snapshot) const {
  std::vector<const Mesh*> meshes;
  snapshot.meshes.for_each([&](u32, const Shared<Mesh>& row) {
    if (row.uses > 0 && !row.value->topology->triangles.empty()) meshes.push_back(row.value.get());
  });
  std::vector<Status> results(meshes.size());
  parallel_for(meshes.size(), [&](std::size_t i) {
    if (auto made = builder_.build(*meshes[i]); !made)
      results[i] = std::unexpected(std::move(made).error());
  });
  for (Status& result : results) HELIO_TRY(std::move(result));
  for_each_grid(snapshot, [&](const Grid& grid) { (void)grid_table(grid, cache_); });
  if (snapshot.dome)
    if (const auto* texture = snapshot.find(snapshot.dome->texture))
      (void)dome_tables(*texture->value, cache_);
  return {};
}

std::shared_ptr<const ResidentScene> SceneStore::nearest(const Snapshot& snapshot,
                                                         const TimeSpan& span) const {
  const std::scoped_lock lock(mutex_);
  std::shared_ptr<const ResidentScene> best;
  int best_score = -1;
  for (const auto& scene : recent_) {
    const Snapshot& before = scene->snapshot();
    const int score = 8 * int(same_structure(before, snapshot)) +
                      4 * int(same_poses(*scene, snapshot, span)) +
                      2 * int(same_materials(before, snapshot)) + int(before.dome == snapshot.dome);
    if (score >= best_score) {
      best_score = score;
      best = scene;
    }
  }
  return best;
}

void SceneStore::keep(std::shared_ptr<const ResidentScene> scene) {
  std::vector<std::shared_ptr<const ResidentScene>> gone;  // without the lock
  const std::scoped_lock lock(mutex_);
  recent_.push_back(std::move(scene));
  const auto sum = [&] {
    u64 bytes = 0;
    for (const auto& kept : recent_) bytes += kept->bytes();
    return bytes;
  };
  while (recent_.size() > 1 && (recent_.size() > kScenesKept || sum() > limit_)) {
    gone.push_back(std::move(recent_.front()));
    recent_.erase(recent_.begin());
  }
  bytes_ = sum();
}

}  // namespace heliograph::resident
