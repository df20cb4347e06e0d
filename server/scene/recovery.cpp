// Decodes snapshots and applies the records after them. See recovery.h.
#include "server/scene/recovery.h"

#include <fmt/format.h>

#include <limits>

#include "server/journal/sources.h"
#include "server/scene/scene_info.h"

namespace heliograph::server {
namespace {

/// Limits for replay: a transaction that was accepted once is accepted again.
constexpr SceneLimits kNoLimits{.entities = std::numeric_limits<u32>::max(),
                                .array_bytes = std::numeric_limits<u64>::max(),
                                .revisions = 1};

/// Limits of tenants during recovery: none.
Limits no_limits() {
  Limits limits;
  limits.tenant_bytes = limits.tenant_entities = limits.scenes = std::numeric_limits<u64>::max();
  return limits;
}

std::unexpected<Error> broken(std::string what) {
  return fail(Code::kInternal, "", std::move(what));
}

class Recovery {
 public:
  Recovery(Journal& journal, const RecoveryTarget& target) : journal_(journal), target_(target) {}

  [[nodiscard]] Status add_scene(const journal::SceneRow& row);
  void drop(u64 scene, Status because);
  [[nodiscard]] Status add_record(u64 id, const journal::Record& record,
                                  const v1::Transaction* transaction);
  [[nodiscard]] Expected<Recovered> finish();

 private:
  /// The edits of a session; replies are made once it is known which are kept.
  struct Log {
    u64 last = 0;
    std::deque<EditLog::Reply> kept;
  };
  struct Scene {
    journal::SceneRow row;
    std::shared_ptr<const Snapshot> head;
    std::map<u64, Log> logs;
    std::shared_ptr<SceneEvents> events;
  };
  /// Stores and budgets that one tenant's arrays are read from and charged to.
  struct Owner {
    TenantPtr tenant;
    std::unique_ptr<RecoveringSource> source;
  };
  [[nodiscard]] Owner& owner(const std::string& tenant);
  [[nodiscard]] std::shared_ptr<SceneEvents> restore_events(const journal::SceneRow& row,
                                                            const Snapshot& head,
                                                            const journal::State& state);
  [[nodiscard]] Expected<EditLog::Reply> apply_record(u64 id, const journal::Record& record,
                                                      const v1::Transaction* message, Scene& scene);

  Journal& journal_;
  const RecoveryTarget& target_;
  std::map<std::string, Owner> owners_;
  std::map<u64, Scene> scenes_;
  Recovered recovered_;
};

Recovery::Owner& Recovery::owner(const std::string& tenant) {
  Owner& owner = owners_[tenant];
  if (owner.source) return owner;
  BlobFiles& files = journal_.files(tenant);
  owner.tenant = target_.tenants.named(tenant);
  owner.tenant->give({.limits = no_limits()});
  owner.source = std::make_unique<RecoveringSource>(*owner.tenant, files);
  return owner;
}

std::shared_ptr<SceneEvents> Recovery::restore_events(const journal::SceneRow& row,
                                                      const Snapshot& head,
                                                      const journal::State& state) {
  const Tenant& tenant = *owner(row.tenant()).tenant;
  Revision revision = head.revision - u64(state.events_size());
  auto events = target_.scenes.make_events(tenant, revision);
  if (row.owner() == 0 || state.events_size() > 0) events->keep();
  for (const std::string& event : state.events())
    events->add(++revision, std::make_shared<const std::string>(event));
  return events;
}

Status Recovery::add_scene(const journal::SceneRow& row) {
  RecoveringSource& source = *owner(row.tenant()).source;
  journal::State state;
  {
    auto bytes = source.content(row.state());
    if (!bytes) return std::unexpected(std::move(bytes).error());
    if (!state.ParseFromString(*bytes)) return broken("the snapshot cannot be read");
  }
  auto head = decode_scene(state, source, kNoLimits);
  if (!head) return std::unexpected(std::move(head).error());
  Scene& scene = scenes_[row.scene()];
  scene = {.row = row, .head = std::move(*head), .logs = {}, .events = {}};
  scene.events = restore_events(row, *scene.head, state);
  for (const journal::Log& each : state.logs()) {
    LogState log = decode_log(each);
    scene.logs[log.session] = {.last = log.edits.last,
                               .kept = {std::make_move_iterator(log.edits.kept.begin()),
                                        std::make_move_iterator(log.edits.kept.end())}};
  }
  auto needed = source.take_files();
  if (!row.saved()) journal_.hold(row.scene(), 0, std::move(needed));
  return {};
}

/// Drops a saved scene that cannot be recovered: it would have ended with its daemon anyway, so
/// that is no reason not to start.
void Recovery::drop(u64 scene, Status because) {
  scenes_.erase(scene);
  ++recovered_.dropped;
  recovered_.because = std::move(because);
}

Status Recovery::add_record(u64 id, const journal::Record& record,
                            const v1::Transaction* transaction) {
  const auto found = scenes_.find(record.scene());
  if (found == scenes_.end()) return {};  // deleted by a later record
  Scene& scene = found->second;
  if (id <= scene.row.record()) return {};
  Log& log = scene.logs[record.session()];
  if (record.number() != log.last + 1)
    return broken(fmt::format("holds edit {} after edit {}", record.number(), log.last));
  log.last = record.number();
  ++recovered_.records;
  auto reply = record.revision() != 0 ? apply_record(id, record, transaction, scene)
                                      : std::make_shared<const Expected<v1::ApplyReply>>(
                                            std::unexpected(decode_refusal(record.refusal())));
  if (!reply) return std::unexpected(std::move(reply).error());
  log.kept.push_back(std::move(*reply));
  if (log.kept.size() > target_.scenes.replies()) log.kept.pop_front();
  return {};
}

Expected<EditLog::Reply> Recovery::apply_record(u64 id, const journal::Record& record,
                                                const v1::Transaction* message, Scene& scene) {
  RecoveringSource& source = *owner(scene.row.tenant()).source;
  source.expect(record);
  std::string file;
  v1::Transaction large;
  if (!message) {
    auto content = source.content(record.transaction_file());
    if (!content) return std::unexpected(std::move(content).error());
    file = std::move(*content);
    if (!large.ParseFromString(file)) return broken("its transaction cannot be read");
  }
  auto transaction = to_transaction(message ? *message : large, source);
  large.Clear();
  if (!transaction) return std::unexpected(std::move(transaction).error());
  auto prepared = apply(*scene.head, *transaction, kNoLimits);
  if (!prepared) return std::unexpected(std::move(prepared).error());
  if (prepared->snapshot->revision != record.revision())
    return broken(
        fmt::format("makes revision {}, not {}", prepared->snapshot->revision, record.revision()));
  scene.head = prepared->snapshot;
  scene.events->add(record.revision(), event_of(message ? record.transaction() : file, *prepared));
  if (auto files = source.take_files(); !files.empty())
    journal_.hold(record.scene(), id, std::move(files));
  return std::make_shared<const Expected<v1::ApplyReply>>(apply_reply(record.number(), *prepared));
}

Expected<Recovered> Recovery::finish() {
  target_.scenes.use(journal_);
  for (auto& [id, scene] : std::exchange(scenes_, {})) {
    const TenantPtr& tenant = owner(scene.row.tenant()).tenant;
    SceneState state{.row = scene.row,
                     .head = std::move(scene.head),
                     .logs = {},
                     .events = std::move(scene.events)};
    for (auto& [session, log] : scene.logs) {
      state.logs.push_back({.session = session,
                            .edits = {.last = log.last,
                                      .kept = {std::make_move_iterator(log.kept.begin()),
                                               std::make_move_iterator(log.kept.end())}}});
      recovered_.sessions[session] = tenant;
    }
    Status restored = target_.scenes.restore(std::move(state), tenant);
    if (!restored && !scene.row.saved()) return std::unexpected(std::move(restored).error());
    if (!restored) {
      drop(id, std::move(restored));
      continue;
    }
    if (const u64 owner = scene.row.owner(); owner != 0) {
      recovered_.sessions[owner] = tenant;
      recovered_.owners.insert(owner);
    }
    ++(scene.row.saved() ? recovered_.saved : recovered_.scenes);
  }
  for (const auto& [name, owner] : owners_)
    (void)target_.tenants.named(name);  // applies the tenant's limits
  return recovered_;
}

}  // namespace

Expected<Recovered> recover(Journal& journal, const RecoveryTarget& target) {
  Recovery recovery(journal, target);
  HELIO_TRY(journal.read(
      [&](const journal::SceneRow& row) -> Status {
        auto added = recovery.add_scene(row);
        if (added) return {};
        Error why = std::move(added).error().at(fmt::format("scene {}", row.scene()));
        if (!row.saved()) return std::unexpected(std::move(why));
        recovery.drop(row.scene(), std::unexpected(std::move(why)));
        return {};
      },
      [&](u64 id, const journal::Record& record, const v1::Transaction* transaction) {
        return recovery.add_record(id, record, transaction);
      }));
  return recovery.finish();
}

}  // namespace heliograph::server
