// Creating, finding and freeing scenes. Called by the scene handlers and when a session ends.
#include "server/scene/scenes.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>

#include "server/os/mutant.h"
#include "server/scene/lifetime.h"
#include "server/scene/scene_info.h"

namespace heliograph::server {
namespace {

constexpr std::size_t kNameBytes = 1024;
constexpr u32 kManyEntities = 4096;  // entities from which old revisions are freed in the pool

std::unexpected<Error> not_found(u64 id) {
  return fail(Code::kNotFound, "scene",
              fmt::format("there is no scene {}; it was deleted, or its session ended", id));
}

/// Returns a scene's row; fields that its snapshot provides are left empty.
journal::SceneRow row_of(const SceneEntry& entry) {
  journal::SceneRow row;
  row.set_scene(entry.id);
  row.set_tenant(entry.tenant->name);
  row.set_name(entry.name);
  row.set_durability(durability_of(entry.lifetime));
  row.set_session(entry.made_by.session);
  row.set_request_id(entry.made_by.request_id);
  row.set_method(entry.made_by.method);
  row.set_owner(entry.owner);
  return row;
}

}  // namespace

Expected<Prepared> SceneEntry::prepare(const Transaction& transaction,
                                       std::optional<Revision> expected) {
  const auto before = scene.pending();
  auto prepared = scene.prepare(transaction, expected);
  if (!prepared) return prepared;
  if (auto room = charges_.add(*before, transaction, *prepared); !room) {
    scene.drop_pending(prepared->snapshot->revision);
    return std::unexpected(std::move(room).error().at("edits"));
  }
  return prepared;
}

Expected<Prepared> SceneEntry::commit(const Transaction& transaction,
                                      std::optional<Revision> expected,
                                      const v1::Transaction& sent) {
  Expected<Prepared> prepared;
  {
    const std::lock_guard lock(commit_mutex_);
    prepared = prepare(transaction, expected);
    if (!prepared) return prepared;
    publish(*prepared, events->is_kept() ? event_of(sent.SerializeAsString(), *prepared) : nullptr);
  }
  notify(prepared->snapshot->revision);
  return prepared;
}

void SceneEntry::publish(const Prepared& prepared, SceneEvents::Event event) {
  auto forgotten = scene.publish(prepared);
  if (!forgotten.empty()) charges_.forget(forgotten.back()->revision);
  events->add(prepared.snapshot->revision, std::move(event));
  if (prepared.snapshot->entities.capacity() >= kManyEntities) free_aside(std::move(forgotten));
}

/// Frees forgotten revisions in the pool, those of one publication at a time so that they do not
/// pile up; the others here, and all here when the pool is full.
void SceneEntry::free_aside(std::vector<std::shared_ptr<const Snapshot>> forgotten) {
  if (forgotten.empty() || is_freeing_->exchange(true)) return;
  const auto posted =
      pool_.post(tenant->id, [held = std::move(forgotten), is_freeing = is_freeing_]() mutable {
        held.clear();
        *is_freeing = false;
      });
  if (!posted) *is_freeing_ = false;
}

std::shared_ptr<SceneEvents> SceneEntry::watched() {
  if (!events->is_kept()) {
    const std::lock_guard lock(commit_mutex_);  // no commit is in progress
    events->keep();
  }
  return events;
}

SceneEntry::Watch SceneEntry::watch(std::function<void(Revision)> on_revision) {
  auto watch = std::make_shared<const std::function<void(Revision)>>(std::move(on_revision));
  const std::lock_guard lock(mutex_);
  std::erase_if(watches_, [](const auto& other) { return other.expired(); });
  watches_.push_back(watch);
  return watch;
}

void SceneEntry::notify(Revision revision) {
  if (has_bug("drop_watch_event") && revision % 8 == 0) return;
  std::vector<Watch> watches;
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(watches_, [](const auto& watch) { return watch.expired(); });
    for (const auto& watch : watches_)
      if (auto found = watch.lock()) watches.push_back(std::move(found));
  }
  for (const Watch& watch : watches) (*watch)(revision);
}

void Scenes::use(Journal& journal) { journal_ = &journal; }

Status Scenes::check_lifetime(v1::Lifetime lifetime) const {
  if (!is_durable(lifetime) || journal_) return {};
  return fail(Code::kFailedPrecondition, "lifetime",
              "this daemon has no state directory; start it with --state-dir DIR");
}

/// Returns a random id: it reveals nothing about other scenes, and does not recur by chance. 53
/// bits, to fit a JavaScript number.
u64 Scenes::new_id() const {
  u64 id = 0;
  while (id == 0 || scenes_.contains(id)) {
    [[maybe_unused]] const auto size = ::getrandom(&id, sizeof id, 0);  // never short for 8 bytes
    id >>= 11;
  }
  return id;
}

Expected<ScenePtr> Scenes::add(SceneEntry::Identity identity,
                               std::shared_ptr<const Snapshot> first) {
  auto charges = SceneCharges::take(identity.tenant->ledger, *first);
  if (!charges) return std::unexpected(std::move(charges).error());
  if (!identity.events) identity.events = make_events(*identity.tenant, first->revision);
  if (identity.owner == 0) identity.events->keep();
  const std::lock_guard lock(mutex_);
  if (!identity.name.empty() && named(identity.name, *identity.tenant))
    return fail(Code::kAlreadyExists, "name",
                "a scene '" + identity.name + "' exists; open it, or choose another name");
  if (identity.id == 0) identity.id = new_id();
  for (const auto& [id, scene] : scenes_)
    if (scene->tenant == identity.tenant)
      identity.number = std::max(identity.number, scene->number + 1);
  auto entry = std::make_shared<SceneEntry>(std::move(identity), std::move(*charges),
                                            std::move(first), options_.scene, pool_);
  scenes_.emplace(entry->id, entry);
  return entry;
}

Expected<ScenePtr> Scenes::create(NewScene scene, const Session& session) {
  if (scene.name.size() > kNameBytes)
    return fail(Code::kInvalidArgument, "name", fmt::format("is longer than {} bytes", kNameBytes));
  HELIO_TRY(check_lifetime(scene.lifetime));
  const auto change = write_barrier_.begin();
  if (!change) return std::unexpected(change.error());
  const v1::Lifetime lifetime = or_default(scene.lifetime);
  SceneEntry::Identity identity{.name = std::move(scene.name),
                                .owner = lifetime == v1::LIFETIME_SESSION ? session.id() : 0,
                                .tenant = session.tenant(),
                                .lifetime = lifetime,
                                .journal = is_durable(lifetime) ? journal_ : nullptr,
                                .made_by = {.session = session.id(),
                                            .request_id = std::move(scene.request_id),
                                            .method = std::move(scene.method)}};
  auto entry = add(std::move(identity), scene.first);
  if (!entry) return entry;
  if (auto open = check_open(session); !open) {  // a session that ends later frees it
    const std::lock_guard lock(mutex_);
    scenes_.erase((*entry)->id);
    return std::unexpected(std::move(open).error());
  }
  if (is_durable(lifetime)) {
    SceneState state{.row = row_of(**entry), .head = std::move(scene.first), .logs = {}};
    if (auto added = journal_->add(std::move(state)); !added) {
      const std::lock_guard lock(mutex_);
      scenes_.erase((*entry)->id);
      return std::unexpected(std::move(added).error());
    }
  }
  (*entry)->is_published_ = true;
  return entry;
}

Status Scenes::restore(SceneState state, const TenantPtr& tenant) {
  auto entry = add({.id = state.row.scene(),
                    .name = state.row.name(),
                    .owner = state.row.owner(),
                    .tenant = tenant,
                    .lifetime = lifetime_of(state.row),
                    .journal = state.row.saved() ? nullptr : journal_,
                    .made_by = {.session = state.row.session(),
                                .request_id = state.row.request_id(),
                                .method = state.row.method()},
                    .events = std::move(state.events)},
                   std::move(state.head));
  if (!entry) return std::unexpected(std::move(entry).error());
  for (LogState& log : state.logs) edits(**entry, log.session)->restore(std::move(log.edits));
  (*entry)->is_published_ = true;
  return {};
}

std::shared_ptr<SceneEvents> Scenes::make_events(const Tenant& tenant, Revision head) const {
  return std::make_shared<SceneEvents>(options_.events, tenant.ledger.bytes, head);
}

std::vector<SceneState> Scenes::capture(const std::set<u64>& scenes) const {
  std::vector<SceneState> states;
  for (const u64 id : scenes) {
    ScenePtr entry;
    {
      const std::lock_guard lock(mutex_);
      if (const auto found = scenes_.find(id); found != scenes_.end()) entry = found->second;
    }
    if (entry) states.push_back(state_of(*entry));
  }
  return states;
}

SceneState Scenes::state_of(SceneEntry& entry) {
  SceneState state{
      .row = row_of(entry), .head = entry.scene.head(), .logs = {}, .events = entry.events};
  const std::lock_guard lock(entry.mutex_);
  for (const auto& [session, log] : entry.edits_)
    state.logs.push_back({.session = session, .edits = log->state()});
  return state;
}

std::vector<SceneState> Scenes::capture_last() {
  write_barrier_.stop();
  std::vector<SceneState> states;
  for (const ScenePtr& entry : all())
    if (!entry->journal && entry->is_published_) states.push_back(state_of(*entry));
  return states;
}

ScenePtr Scenes::named(const std::string& name, const Tenant& tenant) const {
  const auto found = std::ranges::find_if(scenes_, [&](const auto& entry) {
    return entry.second->name == name && entry.second->tenant.get() == &tenant;
  });
  return found == scenes_.end() ? nullptr : found->second;
}

Expected<ScenePtr> Scenes::find(u64 id, const Session& session) const {
  const std::lock_guard lock(mutex_);
  const auto found = scenes_.find(id);
  if (found == scenes_.end() || !found->second->is_published_ || !found->second->seen_by(session))
    return not_found(id);
  return found->second;
}

Expected<ScenePtr> Scenes::open(const std::string& name, const Session& session) const {
  const std::lock_guard lock(mutex_);
  if (auto scene = name.empty() ? nullptr : named(name, *session.tenant());
      scene && scene->is_published_)
    return scene;
  Error error{.code = Code::kNotFound,
              .message = "there is no scene '" + name + "'; create_scene makes it",
              .where = "name"};
  for (const auto& [id, scene] : scenes_)
    if (!scene->name.empty() && scene->is_published_ && scene->seen_by(session) &&
        error.nearest.size() < 8)
      error.nearest.push_back(scene->name);
  return std::unexpected(std::move(error));
}

std::vector<ScenePtr> Scenes::list(const Session& session) const {
  std::vector<ScenePtr> seen;
  const std::lock_guard lock(mutex_);
  for (const auto& [id, scene] : scenes_)
    if (scene->is_published_ && scene->seen_by(session)) seen.push_back(scene);
  std::ranges::sort(seen, {}, [](const ScenePtr& scene) { return scene->number; });
  return seen;
}

std::vector<ScenePtr> Scenes::all() const {
  std::vector<ScenePtr> all;
  const std::lock_guard lock(mutex_);
  for (const auto& [id, scene] : scenes_) all.push_back(scene);
  return all;
}

Status Scenes::remove(u64 id, const Session& session) {
  auto removed = find(id, session);
  if (!removed) return std::unexpected(removed.error());
  const auto change = write_barrier_.begin();
  if (!change) return std::unexpected(change.error());
  if ((*removed)->journal) HELIO_TRY((*removed)->journal->remove(id, (*removed)->tenant->name));
  {
    const std::lock_guard lock(mutex_);
    if (scenes_.erase(id) == 0) return not_found(id);
  }
  free_later({std::move(*removed)});
  return {};
}

void Scenes::end_session(u64 session) {
  free_private(session);
  for (const ScenePtr& scene : all()) {
    const std::lock_guard lock(scene->mutex_);
    scene->edits_.erase(session);
  }
}

void Scenes::free_private(u64 session) {
  std::vector<ScenePtr> mine;
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(scenes_, [&](auto& entry) {
      const bool is_mine = entry.second->owner == session;
      if (is_mine) mine.push_back(entry.second);
      return is_mine;
    });
  }
  free_later(std::move(mine));
}

void Scenes::free_later(std::vector<ScenePtr> scenes) {
  if (scenes.empty()) return;
  if (has_bug("leak_scene")) new std::vector<ScenePtr>(scenes);
  auto held = std::make_shared<std::vector<ScenePtr>>(std::move(scenes));
  // When the pool is full they are freed here, as this function returns.
  [[maybe_unused]] const auto posted = pool_.post(WorkPool::kDaemon, [held] { held->clear(); });
}

std::shared_ptr<EditLog> Scenes::edits(SceneEntry& scene, u64 session) {
  const std::lock_guard lock(scene.mutex_);
  auto& log = scene.edits_[session];
  if (!log)
    log =
        std::make_shared<EditLog>(std::make_shared<Strand>(pool_, scene.tenant->id, options_.queue),
                                  options_.replies, Charge::none(scene.tenant->ledger.bytes));
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
