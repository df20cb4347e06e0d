// Snapshots to scenes, by difference from the nearest one kept.
#include "renderer/resident/scene.h"

#include <algorithm>
#include <tuple>

#include "renderer/resident/parallel.h"

namespace heliograph::resident {
namespace {

constexpr std::size_t kScenesKept = 8;

/// Whether nothing that decides on poses in a span differs between a scene and a snapshot.
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

/// How much of its entities a snapshot shares with another.
u32 shared_chunks(const Snapshot& a, const Snapshot& b) {
  u32 shared = 0;
  for (u32 c = 0; c < b.poses.chunk_count(); ++c)
    shared += u32(a.entities.shares(c, b.entities)) + u32(a.poses.shares(c, b.poses));
  return shared;
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

Expected<std::shared_ptr<const ResidentScene>> SceneStore::prepare(
    const std::shared_ptr<const Snapshot>& snapshot, const TimeSpan& span,
    const Interrupt& interrupt) {
  const SceneAt wanted{snapshot, span};
  auto all = prepare_all(std::span(&wanted, 1), interrupt);
  if (!all) return std::unexpected(std::move(all).error());
  return std::static_pointer_cast<const ResidentScene>(all->front());
}

Expected<DeviceScenes> SceneStore::prepare_all(std::span<const SceneAt> scenes,
                                               const Interrupt& interrupt) {
  if (scenes.empty()) return DeviceScenes();
  const State before = nearest(*scenes.front().snapshot, scenes.front().span);
  std::vector<Expected<State>> made(scenes.size());
  parallel_invoke([&] { make_room(before); },
                  [&] {
                    parallel_for(scenes.size(), [&](std::size_t i) {
                      made[i] = make(scenes[i], before, interrupt);
                    });
                  });
  for (const auto& state : made)
    if (!state) return std::unexpected(state.error());
  DeviceScenes all;
  for (const auto& state : made)
    all.push_back(*state == before || &state == &made.back()
                      ? scene_of(*state)
                      : std::make_shared<const ResidentScene>(*state, flat_, builder_));
  return all;
}

Expected<std::shared_ptr<const Structure>> SceneStore::structure_of(const Snapshot& snapshot,
                                                                    const State& before) const {
  if (before && same_structure(before->snapshot(), snapshot)) return before->placement().structure;
  return make_structure(snapshot, builder_);
}

Expected<SceneStore::State> SceneStore::make(const SceneAt& wanted, const State& before,
                                             const Interrupt& interrupt) const {
  const auto& [snapshot, span] = wanted;
  const ScenePieces* old = before ? &before->pieces() : nullptr;
  auto structure = structure_of(*snapshot, before);
  if (!structure) return std::unexpected(std::move(structure).error());
  const bool same_slots = old && *structure == old->placement->structure;
  ScenePieces pieces;
  pieces.materials = old && same_materials(before->snapshot(), *snapshot)
                         ? old->materials
                         : make_materials(*snapshot, cache_);
  pieces.surfaces = same_slots && pieces.materials == old->materials
                        ? old->surfaces
                        : make_surfaces(**structure, *pieces.materials,
                                        same_slots ? old->surfaces.get() : nullptr);
  if (same_slots && same_poses(*before, *snapshot, span) &&
      pieces.surfaces->holes == old->placement->holes) {
    pieces.placement = old->placement;
  } else {
    std::optional<PlacedBefore> placed;
    if (old) placed.emplace(PlacedBefore{before->snapshot(), *old->placement});
    auto made = make_placement({*snapshot, span}, {*std::move(structure), pieces.surfaces->holes},
                               placed ? &*placed : nullptr, {builder_, accelerator_, interrupt});
    if (!made) return std::unexpected(std::move(made).error());
    pieces.placement = *std::move(made);
  }
  HELIO_TRY(interrupt.status());
  const bool same_placement = old && pieces.placement == old->placement;
  if (same_placement && pieces.materials == old->materials &&
      before->snapshot().dome == snapshot->dome &&
      before->snapshot().revision == snapshot->revision)
    return before;
  pieces.volumes =
      same_placement ? old->volumes : make_volumes(*snapshot, *pieces.placement, cache_);
  std::optional<LightsBefore> lights;
  if (old)
    lights.emplace(
        LightsBefore{{before->snapshot(), *old->placement, old->materials}, old->lights});
  pieces.lights = make_lights({*snapshot, *pieces.placement, pieces.materials},
                              lights ? &*lights : nullptr, cache_);
  return std::make_shared<const SceneState>(snapshot, span, std::move(pieces));
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

/// The one that shares most; of those the latest.
SceneStore::State SceneStore::nearest(const Snapshot& snapshot, const TimeSpan& span) const {
  const std::scoped_lock lock(mutex_);
  const auto score = [&](const Recent& recent) {
    const Snapshot& before = recent.state->snapshot();
    return std::tuple(same_poses(*recent.state, snapshot, span), shared_chunks(before, snapshot),
                      same_materials(before, snapshot), before.dome == snapshot.dome);
  };
  const auto best = std::ranges::max_element(recent_.rbegin(), recent_.rend(), {}, score);
  return best == recent_.rend() ? nullptr : best->state;
}

void SceneStore::free_later(std::shared_ptr<const ResidentScene> scene) {
  const std::scoped_lock lock(mutex_);
  gone_.push_back(std::move(scene));
}

void SceneStore::make_room(const State& used) {
  Recent oldest;  // this and the next without the lock
  std::vector<std::shared_ptr<const ResidentScene>> gone;
  const std::scoped_lock lock(mutex_);
  gone.swap(gone_);
  if (recent_.size() < kScenesKept) return;
  const auto at = recent_.begin() + (recent_.front().state == used ? 1 : 0);
  oldest = std::move(*at);
  recent_.erase(at);
}

std::shared_ptr<const ResidentScene> SceneStore::scene_of(const State& state) {
  std::vector<Recent> gone;  // without the lock
  const std::scoped_lock lock(mutex_);
  auto known = std::ranges::find(recent_, state, &Recent::state);
  if (known != recent_.end())
    if (auto scene = known->scene.lock()) return scene;
  auto scene = std::make_shared<const ResidentScene>(state, flat_, builder_);
  if (known != recent_.end()) {
    known->scene = scene;
    return scene;
  }
  recent_.push_back({state, scene});
  const auto sum = [&] {
    u64 bytes = 0;
    const SceneState* before = nullptr;
    for (const Recent& kept : recent_) {
      bytes += kept.state->bytes_beside(before);
      before = kept.state.get();
    }
    return bytes;
  };
  while (recent_.size() > 1 && (recent_.size() > kScenesKept || sum() > limit_)) {
    gone.push_back(std::move(recent_.front()));
    recent_.erase(recent_.begin());
  }
  bytes_ = sum();
  return scene;
}

}  // namespace heliograph::resident
