// Directory of scenes: names, private and shared scenes, branches, and each session's edits.
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "renderer/scene/scene.h"
#include "server/journal/journal.h"
#include "server/scene/scene_charges.h"
#include "server/scene/write_barrier.h"
#include "server/session/request_log.h"
#include "server/session/session.h"
#include "server/store/scene_events.h"

namespace heliograph::server {

/// An edit of a durable scene on its way into the journal.
struct DurableEdit {
  Expected<Transaction> transaction;  // or the reason why it was refused before it was applied
  std::optional<Revision> expected;
  journal::Record record;  // session, number, and the transaction, or the file that holds it
  std::string sent;        // the transaction, where a file holds it
  std::vector<BlobFilePtr> files;
};

/// A scene and its access rights. Thread: any.
class SceneEntry : public std::enable_shared_from_this<SceneEntry> {
 public:
  /// The call that made it.
  struct Origin {
    u64 session = 0;
    std::string request_id;
    std::string method;
  };
  struct Identity {
    u64 id = 0;
    std::string name;
    u64 owner = 0;
    TenantPtr tenant;
    v1::Lifetime lifetime = v1::LIFETIME_SESSION;
    Journal* journal = nullptr;
    Origin made_by = {};
    u64 number = 0;
    std::shared_ptr<SceneEvents> events = {};  // null: none so far
  };
  /// pool   frees old revisions
  SceneEntry(Identity identity, SceneCharges charges, std::shared_ptr<const Snapshot> first,
             const SceneLimits& limits, WorkPool& pool)
      : id(identity.id),
        name(std::move(identity.name)),
        owner(identity.owner),
        tenant(std::move(identity.tenant)),
        lifetime(identity.lifetime),
        journal(identity.journal),
        made_by(std::move(identity.made_by)),
        number(identity.number),
        events(std::move(identity.events)),
        scene(first, limits),
        pool_(pool),
        charges_(std::move(charges)) {}

  const u64 id;
  const std::string name;  // "": anonymous
  const u64 owner;         // session whose end deletes it; 0: none
  const TenantPtr tenant;
  const v1::Lifetime lifetime;
  Journal* const journal;  // of a durable scene
  const Origin made_by;
  const u64 number;  // increasing in order of creation or recovery, per tenant
  const std::shared_ptr<SceneEvents> events;
  Scene scene;

  /// A subscription: while it is held, `on_revision` is called with each new revision, from the
  /// thread that published it. It must not block.
  using Watch = std::shared_ptr<const std::function<void(Revision)>>;
  [[nodiscard]] Watch watch(std::function<void(Revision)> on_revision);

  /// Returns its events, and keeps them from now on.
  [[nodiscard]] std::shared_ptr<SceneEvents> watched();

  /// Prepares and publishes a transaction; serialised among the sessions that edit the scene. sent:
  /// the transaction as received.
  [[nodiscard]] Expected<Prepared> commit(const Transaction& transaction,
                                          std::optional<Revision> expected,
                                          const v1::Transaction& sent);
  /// The same for a durable scene: journals the outcome (or the earlier refusal), and publishes
  /// once that is committed. `finish` is called once, from any thread.
  void commit(DurableEdit edit, const EditLog::Finish& finish);
  /// Access is by tenant, not by session: forked and unpickled clients work on their parent's
  /// scenes.
  [[nodiscard]] bool seen_by(const Session& session) const { return session.tenant() == tenant; }

 private:
  friend class Scenes;
  void notify(Revision revision);
  [[nodiscard]] Expected<Prepared> prepare(const Transaction& transaction,
                                           std::optional<Revision> expected);
  void drop_pending(Revision first);
  void end(const Expected<Prepared>& prepared, SceneEvents::Event event, const Status& committed);
  void publish(const Prepared& prepared, SceneEvents::Event event);
  void free_aside(std::vector<std::shared_ptr<const Snapshot>> forgotten);

  WorkPool& pool_;
  const std::shared_ptr<std::atomic<bool>> is_freeing_ = std::make_shared<std::atomic<bool>>(false);
  std::mutex commit_mutex_;
  SceneCharges charges_;                    // guarded by commit_mutex_
  std::atomic<bool> is_published_ = false;  // can be found by id and name
  std::mutex mutex_;
  std::unordered_map<u64, std::shared_ptr<EditLog>> edits_;  // by session
  std::vector<std::weak_ptr<const std::function<void(Revision)>>> watches_;
};
using ScenePtr = std::shared_ptr<SceneEntry>;

struct NewScene {
  std::string name;
  v1::Lifetime lifetime = v1::LIFETIME_UNSPECIFIED;
  std::shared_ptr<const Snapshot> first;
  std::string request_id = {};  // request_id of the call that made it
  std::string method = {};
};

/// The directory. A name is unique among a tenant's scenes; a scene that a session may not see is
/// answered like a missing one. Thread: any.
class Scenes {
 public:
  struct Options {
    SceneLimits scene;
    ReplyLimits replies;
    u32 queue = 64;  // waiting edits per session and scene
    EventLimits events;
  };
  Scenes(WorkPool& pool, Options options) : pool_(pool), options_(options) {}
  /// Allows durable scenes from now on.
  void use(Journal& journal);

  /// Creates a scene. A durable one is journaled first, which takes milliseconds.
  [[nodiscard]] Expected<ScenePtr> create(NewScene scene, const Session& session);
  /// Restores a durable or saved scene with the edit logs of its sessions.
  [[nodiscard]] Status restore(SceneState state, const TenantPtr& tenant);
  /// Makes the events of a scene of this owner at `head`; none are kept yet.
  [[nodiscard]] std::shared_ptr<SceneEvents> make_events(const Tenant& tenant, Revision head) const;
  [[nodiscard]] Expected<ScenePtr> find(u64 id, const Session& session) const;
  [[nodiscard]] Expected<ScenePtr> open(const std::string& name, const Session& session) const;
  /// Returns the scenes that a session sees, oldest first.
  [[nodiscard]] std::vector<ScenePtr> list(const Session& session) const;
  /// Returns the scenes of all tenants.
  [[nodiscard]] std::vector<ScenePtr> all() const;
  [[nodiscard]] Status remove(u64 id, const Session& session);
  /// Frees the session's private scenes and edit logs, in the work pool.
  void end_session(u64 session);
  /// Frees the session's private scenes only.
  void free_private(u64 session);
  [[nodiscard]] std::shared_ptr<EditLog> edits(SceneEntry& scene, u64 session);
  /// Returns the number that this session's next edit must carry.
  [[nodiscard]] u64 next_edit(SceneEntry& scene, u64 session) const;
  /// Returns the journaled state of these scenes.
  [[nodiscard]] std::vector<SceneState> capture(const std::set<u64>& scenes) const;
  /// Returns the final state of scenes that are not durable: ends all writes to them first, so that
  /// everything acknowledged is included.
  [[nodiscard]] std::vector<SceneState> capture_last();
  [[nodiscard]] WriteBarrier& write_barrier() { return write_barrier_; }
  /// Returns how many of a session's replies are kept.
  [[nodiscard]] u64 replies() const { return options_.replies.replies; }
  [[nodiscard]] const SceneLimits& scene_limits() const { return options_.scene; }

 private:
  [[nodiscard]] u64 new_id() const;  // under mutex_
  [[nodiscard]] ScenePtr named(const std::string& name, const Tenant& tenant) const;
  [[nodiscard]] Expected<ScenePtr> add(SceneEntry::Identity identity,
                                       std::shared_ptr<const Snapshot> first);
  [[nodiscard]] Status check_lifetime(v1::Lifetime lifetime) const;
  [[nodiscard]] static SceneState state_of(SceneEntry& entry);
  void free_later(std::vector<ScenePtr> scenes);

  WorkPool& pool_;
  const Options options_;
  Journal* journal_ = nullptr;  // set before the first call
  WriteBarrier write_barrier_;
  mutable std::mutex mutex_;
  std::map<u64, ScenePtr> scenes_;
};

/// Returns the requested revision, or the head.
[[nodiscard]] Expected<std::shared_ptr<const Snapshot>> snapshot_at(
    const SceneEntry& scene, std::optional<Revision> revision);

}  // namespace heliograph::server
