// Creating, finding and freeing scenes. Called by the scene handlers and when a session ends.
#include "server/scenes.h"

#include <fmt/format.h>

#include <algorithm>

namespace heliograph::server {
namespace {

constexpr std::size_t kNameBytes = 1024;

std::unexpected<Error> not_found(u64 id) {
  return fail(Code::kNotFound, "scene",
              fmt::format("there is no scene {}; it was deleted, or its session ended", id));
}

}  // namespace

Expected<Prepared> SceneEntry::commit(const Transaction& transaction,
                                      std::optional<Revision> expected) {
  Expected<Prepared> prepared;
  {
    const std::lock_guard lock(commit_mutex_);
    prepared = scene.prepare(transaction, expected);
    if (!prepared) return prepared;
    if (auto room = entities_.resize(prepared->snapshot->entities.count()); !room) {
      scene.drop_pending();
      return std::unexpected(std::move(room).error().at("edits"));
    }
    scene.publish(*prepared);
  }
  tell(prepared->snapshot->revision);
  return prepared;
}

SceneEntry::Watch SceneEntry::watch(std::function<void(Revision)> told) {
  auto watch = std::make_shared<const std::function<void(Revision)>>(std::move(told));
  const std::lock_guard lock(mutex_);
  std::erase_if(watches_, [](const auto& other) { return other.expired(); });
  watches_.push_back(watch);
  return watch;
}

void SceneEntry::tell(Revision revision) {
  std::vector<Watch> told;
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(watches_, [](const auto& watch) { return watch.expired(); });
    for (const auto& watch : watches_)
      if (auto found = watch.lock()) told.push_back(std::move(found));
  }
  for (const Watch& watch : told) (*watch)(revision);
}

Expected<ScenePtr> Scenes::create(NewScene scene, const Session& session) {
  if (scene.name.size() > kNameBytes)
    return fail(Code::kInvalidArgument, "name", fmt::format("is longer than {} bytes", kNameBytes));
  const u64 owner = scene.is_shared ? 0 : session.id();
  auto entities = Charge::take(session.tenant()->entities, scene.first->entities.count());
  if (!entities) return std::unexpected(std::move(entities).error());
  const std::lock_guard lock(mutex_);
  if (!scene.name.empty() && named(scene.name, session))
    return fail(Code::kAlreadyExists, "name",
                "a scene '" + scene.name + "' exists; open it, or choose another name");
  if (scenes_.size() >= options_.limit)
    return fail(Code::kResourceExhausted, "",
                fmt::format("{} scenes exist; delete one (limit scenes)", scenes_.size()));
  auto entry = std::make_shared<SceneEntry>(
      SceneEntry::Identity{++last_id_, std::move(scene.name), owner, session.tenant()},
      std::move(*entities), std::move(scene.first), options_.scene);
  scenes_.emplace(entry->id, entry);
  return entry;
}

ScenePtr Scenes::named(const std::string& name, const Session& session) const {
  const auto found = std::ranges::find_if(scenes_, [&](const auto& entry) {
    return entry.second->name == name && entry.second->seen_by(session);
  });
  return found == scenes_.end() ? nullptr : found->second;
}

Expected<ScenePtr> Scenes::find(u64 id, const Session& session) const {
  const std::lock_guard lock(mutex_);
  const auto found = scenes_.find(id);
  if (found == scenes_.end() || !found->second->seen_by(session)) return not_found(id);
  return found->second;
}

Expected<ScenePtr> Scenes::open(const std::string& name, const Session& session) const {
  const std::lock_guard lock(mutex_);
  if (auto scene = name.empty() ? nullptr : named(name, session)) return scene;
  Error error{.code = Code::kNotFound,
              .message = "there is no scene '" + name + "'; create_scene makes it",
              .where = "name"};
  for (const auto& [id, scene] : scenes_)
    if (!scene->name.empty() && scene->seen_by(session) && error.nearest.size() < 8)
      error.nearest.push_back(scene->name);
  return std::unexpected(std::move(error));
}

std::vector<ScenePtr> Scenes::list(const Session& session) const {
  std::vector<ScenePtr> seen;
  const std::lock_guard lock(mutex_);
  for (const auto& [id, scene] : scenes_)
    if (scene->seen_by(session)) seen.push_back(scene);
  return seen;
}

std::vector<ScenePtr> Scenes::all() const {
  std::vector<ScenePtr> all;
  const std::lock_guard lock(mutex_);
  for (const auto& [id, scene] : scenes_) all.push_back(scene);
  return all;
}

Status Scenes::remove(u64 id, const Session& session) {
  ScenePtr removed;
  {
    const std::lock_guard lock(mutex_);
    const auto found = scenes_.find(id);
    if (found == scenes_.end() || !found->second->seen_by(session)) return not_found(id);
    removed = std::move(found->second);
    scenes_.erase(found);
  }
  free_later({std::move(removed)});
  return {};
}

void Scenes::end_session(u64 session) {
  std::vector<ScenePtr> mine, shared;
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(scenes_, [&](auto& entry) {
      const bool is_mine = entry.second->owner == session;
      (is_mine ? mine : shared).push_back(entry.second);
      return is_mine;
    });
  }
  for (const ScenePtr& scene : shared) {
    const std::lock_guard lock(scene->mutex_);
    scene->edits_.erase(session);
  }
  free_later(std::move(mine));
}

void Scenes::free_later(std::vector<ScenePtr> scenes) {
  if (scenes.empty()) return;
  auto held = std::make_shared<std::vector<ScenePtr>>(std::move(scenes));
  // When the pool is full they are freed here, at the end of this function.
  [[maybe_unused]] const auto posted = pool_.post([held] { held->clear(); });
}

std::shared_ptr<EditLog> Scenes::edits(SceneEntry& scene, u64 session) {
  const std::lock_guard lock(scene.mutex_);
  auto& log = scene.edits_[session];
  if (!log) log = std::make_shared<EditLog>(pool_, options_.replies, options_.queue);
  return log;
}

u64 Scenes::next_edit(SceneEntry& scene, u64 session) const {
  const std::lock_guard lock(scene.mutex_);
  const auto found = scene.edits_.find(session);
  return found == scene.edits_.end() ? 1 : found->second->next();
}

Expected<std::shared_ptr<const Snapshot>> snapshot_at(const SceneEntry& scene,
                                                      std::optional<Revision> revision) {
  if (revision) return scene.scene.at(*revision);
  return scene.scene.head();
}

}  // namespace heliograph::server
