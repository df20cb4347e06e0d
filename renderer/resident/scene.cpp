// Snapshots to scenes, by difference from the nearest one kept.
#include "renderer/resident/scene.h"

#include <algorithm>
#include <iterator>

#include "renderer/base/parallel.h"

namespace heliograph::resident {

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
  State before;
  {
    const std::scoped_lock lock(mutex_);
    before = kept_.nearest(*scenes.front().snapshot, scenes.front().span);
  }
  std::vector<Expected<State>> made(scenes.size());
  parallel_invoke([&] { free_dead(); },
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

void SceneStore::free_later(std::shared_ptr<const ResidentScene> scene) {
  const std::scoped_lock lock(mutex_);
  gone_.push_back(std::move(scene));
}

bool SceneStore::keeps(const ResidentScene& scene) const {
  const std::scoped_lock lock(mutex_);
  return kept_.has(scene);
}

std::vector<std::shared_ptr<const ResidentScene>> SceneStore::let_go() {
  const std::scoped_lock lock(mutex_);
  return kept_.let_go();
}

void SceneStore::free_dead() {
  KeptScenes::Dropped dropped, dead;  // these without the lock
  std::vector<std::shared_ptr<const ResidentScene>> gone;
  const std::scoped_lock lock(mutex_);
  gone.swap(gone_);
  dropped.swap(dropped_);
  dead = kept_.drop_dead();
  bytes_ = kept_.bytes();
}

/// Scenes have the data they use: what only the cache has goes first.
void SceneStore::make_room() {
  KeptScenes::Dropped dropped;
  DerivedCache::Gone gone;
  do {
    dropped.clear();  // without the lock
    gone.clear();     // the same
    const std::scoped_lock lock(mutex_);
    bytes_ = kept_.bytes();
    const u64 room = limit_ - std::min(limit_, kept_.bytes());
    if (kept_.bytes() + cache_.shrink(room, gone) <= limit_) return;
    dropped = kept_.drop_oldest();
  } while (!dropped.empty());
}

std::shared_ptr<const ResidentScene> SceneStore::scene_of(const State& state) {
  std::shared_ptr<const ResidentScene> scene;
  {
    const std::scoped_lock lock(mutex_);
    KeptScenes::Kept* known = kept_.find(state);
    if (known) scene = known->scene.lock();
    if (scene) return scene;
    scene = std::make_shared<const ResidentScene>(state, flat_, builder_);
    if (known) {
      known->scene = scene;
      return scene;
    }
    std::ranges::move(kept_.add({state, scene}), std::back_inserter(dropped_));
    made_again_ = kept_.made_again();
  }
  make_room();
  return scene;
}

SceneSummary ResidentScene::summary() const {
  const auto glows = [](const kernels::VolumeView& volume) { return volume.emission_scale > 0; };
  const bool uneven = !lights().lights.empty() || !lights().suns.empty() || lights().dome_tables;
  return {.lit = lights().any() || std::ranges::any_of(pieces().volumes->views, glows),
          .focused = uneven && !pieces().surfaces->focusing.empty(),
          .idle = structure().idle,
          .bounds = placement().bounds};
}

}  // namespace heliograph::resident
