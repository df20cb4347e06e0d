// Snapshots from descriptions: a new scene of them, or the very same one. Called by ImportScene and
// by the journal's recovery.
#include "renderer/scene/restore.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>

namespace heliograph {
namespace {

/// `previous` with the objects that the edits of the scene made as its targets.
Expected<Transaction> resolved(Transaction previous, const std::vector<Id>& ids) {
  for (std::size_t i = 0; i < previous.edits.size(); ++i) {
    Ref& target = previous.edits[i].target;
    const auto* created = std::get_if<CreatedByEdit>(&target);
    if (!created) continue;
    if (created->edit >= ids.size())
      return fail(Code::kInvalidArgument, fmt::format("previous.edits[{}].target", i),
                  "is no edit of the scene; the file is damaged");
    target = ids[created->edit];
  }
  return previous;
}

Status add_previous(Snapshot& scene, const SceneDescription& description,
                    const std::vector<Id>& ids, const SceneLimits& limits) {
  auto edits = resolved(description.previous, ids);
  if (!edits) return std::unexpected(std::move(edits).error());
  auto made = apply(scene, *edits, limits);
  if (!made) return std::unexpected(std::move(made).error().at("previous"));
  Snapshot previous = *made->snapshot;
  if (!(previous.time < scene.time))
    return fail(Code::kInvalidArgument, "previous",
                fmt::format("is at {} s, not before the scene's {} s; the file is damaged",
                            previous.time, scene.time));
  previous.previous = nullptr;
  scene.previous = std::make_shared<const Snapshot>(std::move(previous));
  return {};
}

Status add_libraries(Snapshot& scene, const SceneDescription& description,
                     const std::vector<Id>& ids) {
  for (std::size_t i = 0; i < description.libraries.size(); ++i) {
    const auto& kept = description.libraries[i];
    auto library = std::make_shared<Library>();
    for (std::size_t k = 0; k < kept.edits.size(); ++k) {
      if (kept.edits[k] && *kept.edits[k] >= description.scene.edits.size())
        return fail(Code::kInvalidArgument, fmt::format("libraries[{}].objects[{}]", i, k),
                    "is no edit of the scene; the file is damaged");
      library->push_back(kept.edits[k] ? ids[*kept.edits[k]] : Id{});
    }
    scene.libraries.set(kept.asset, std::move(library));
  }
  return {};
}

bool fits(const TableIds& ids) {
  std::vector<bool> seen(ids.versions.size(), false);
  return std::ranges::all_of(ids.order, [&](u32 index) {
    if (index >= seen.size() || seen[index]) return false;
    seen[index] = true;
    return true;
  });
}

/// An empty scene whose next objects get the ids of `numbers`.
Expected<Snapshot> reserved(const SceneNumbers& numbers) {
  for (const TableIds* ids : {&numbers.entities, &numbers.meshes, &numbers.materials,
                              &numbers.textures, &numbers.volumes})
    if (!fits(*ids)) return fail(Code::kInvalidArgument, "numbers", "are no ids of a scene");
  Snapshot empty;
  empty.advances = numbers.advances;
  empty.entities = Table<Entity>::reserved(numbers.entities);
  empty.meshes = Table<Shared<Mesh>>::reserved(numbers.meshes);
  empty.materials = Table<Shared<Material>>::reserved(numbers.materials);
  empty.textures = Table<Shared<Texture>>::reserved(numbers.textures);
  empty.volumes = Table<Shared<Volume>>::reserved(numbers.volumes);
  for (u32 i = 0; i < empty.entities.capacity(); ++i) empty.poses.push_back(mat4x3(1));
  return empty;
}

Expected<std::shared_ptr<Snapshot>> build(const Snapshot& empty,
                                          const SceneDescription& description,
                                          std::span<const u32> without_label,
                                          const SceneLimits& limits) {
  auto made = apply(empty, description.scene, limits);
  if (!made) return std::unexpected(std::move(made).error().at("transaction"));
  auto scene = std::make_shared<Snapshot>(*made->snapshot);
  for (const u32 index : without_label) {
    if (!scene->entities.alive(index))
      return fail(Code::kInvalidArgument, "numbers", "name an entity that is not there");
    scene->entities.write(index).label.set = false;
  }
  if (!description.previous.edits.empty())
    HELIO_TRY(add_previous(*scene, description, made->ids, limits));
  HELIO_TRY(add_libraries(*scene, description, made->ids));
  return scene;
}

}  // namespace

Expected<std::shared_ptr<const Snapshot>> rebuild(const SceneDescription& description,
                                                  const SceneLimits& limits) {
  Snapshot empty;
  empty.advances = description.previous.edits.empty() ? 0 : 1;
  return build(empty, description, {}, limits);
}

SceneNumbers numbers(const Snapshot& snapshot) {
  SceneNumbers out{.revision = snapshot.revision,
                   .advances = snapshot.advances,
                   .next_label = snapshot.next_label,
                   .entities = snapshot.entities.ids(),
                   .meshes = snapshot.meshes.ids(),
                   .materials = snapshot.materials.ids(),
                   .textures = snapshot.textures.ids(),
                   .volumes = snapshot.volumes.ids(),
                   .without_label = {}};
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    if (!entity.label.set && (entity.mesh || entity.volume)) out.without_label.push_back(index);
  });
  return out;
}

Expected<std::shared_ptr<const Snapshot>> restore(const SceneDescription& description,
                                                  const SceneNumbers& numbers,
                                                  const SceneLimits& limits) {
  auto empty = reserved(numbers);
  if (!empty) return std::unexpected(std::move(empty).error());
  auto scene = build(*empty, description, numbers.without_label, limits);
  if (!scene) return std::unexpected(std::move(scene).error());
  (*scene)->next_label = numbers.next_label;
  (*scene)->revision = numbers.revision;
  return scene;
}

}  // namespace heliograph
