// Poses and overlays of a world, as transactions that nobody publishes.
#include "renderer/scene/worlds.h"

#include <fmt/format.h>

#include <algorithm>

namespace heliograph {
namespace {

using SnapshotPtr = std::shared_ptr<const Snapshot>;

/// An array for the time of a call.
template <class T, class U>
ArrayOf<T> borrowed(std::span<const U> values) {
  static_assert(sizeof(T) == sizeof(U));
  return ArrayOf<T>(std::make_shared<const Buffer>(nullptr, std::as_bytes(values)));
}

Expected<SnapshotPtr> with_poses(const SnapshotPtr& scene, const Worlds& worlds, u32 world) {
  if (worlds.entities.empty()) return scene;
  const std::size_t count = worlds.entities.size();
  Poses poses{.ids = borrowed<Id>(std::span(worlds.entities)),
              .matrices = borrowed<mat4x3>(std::span(worlds.poses).subspan(world * count, count)),
              .teleport = worlds.teleport};
  Transaction transaction;
  transaction.edits.push_back({.target = {}, .action = std::move(poses)});
  auto made = apply(*scene, transaction, worlds.limits);
  if (made) return std::move(made->snapshot);
  Error error = std::move(made).error();
  error.where = "poses";
  return std::unexpected(std::move(error));
}

/// Checks that what is stated once for the whole frame is the same in all worlds.
Status check_common(const Snapshot& scene, const Snapshot& world) {
  const auto classes = [](const Snapshot& s) { return s.categories ? s.categories->size() : 0; };
  if (world.time != scene.time || world.previous != scene.previous)
    return fail(Code::kInvalidArgument, "",
                "changes the scene's time, which all worlds have in common; do that in the scene "
                "or in the request's overlay");
  if (classes(world) == classes(scene)) return {};
  return fail(Code::kInvalidArgument, "",
              fmt::format("registers the class '{}', and a class has one number in all worlds; "
                          "register it in the scene or in the request's overlay",
                          world.categories->at(classes(scene))));
}

}  // namespace

Expected<SnapshotPtr> world_of(const SnapshotPtr& scene, const Worlds& worlds, u32 world) {
  auto made = with_poses(scene, worlds, world);
  if (!made) return made;
  if (worlds.has_overlay(world)) {
    const auto at = [&](Error error) {
      return std::unexpected(std::move(error).at(fmt::format("overlays[{}]", world)));
    };
    auto prepared = apply(**made, worlds.overlays[world], worlds.limits);
    if (!prepared) return at(std::move(prepared).error());
    if (auto common = check_common(*scene, *prepared->snapshot); !common)
      return at(std::move(common).error());
    made = std::move(prepared->snapshot);
  }
  if ((*made)->revision == scene->revision) return made;
  auto snapshot = std::make_shared<Snapshot>(**made);
  snapshot->revision = scene->revision;
  return snapshot;
}

}  // namespace heliograph
