// The directory of scenes: names, private and shared ones, branches, and each session's edits.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "renderer/scene/scene.h"
#include "server/request_log.h"
#include "server/session.h"

namespace heliograph::server {

/// A scene and who may see it. Thread: any.
class SceneEntry {
 public:
  struct Identity {
    u64 id = 0;
    std::string name;
    u64 owner = 0;
    TenantPtr tenant;
  };
  SceneEntry(Identity identity, Charge entities, std::shared_ptr<const Snapshot> first,
             const SceneLimits& limits)
      : id(identity.id),
        name(std::move(identity.name)),
        owner(identity.owner),
        tenant(std::move(identity.tenant)),
        scene(std::move(first), limits),
        entities_(std::move(entities)) {}

  const u64 id;
  const std::string name;  // "": anonymous
  const u64 owner;         // the session that a private scene dies with; 0: shared
  const TenantPtr tenant;
  Scene scene;

  /// A token of interest: while it is held, `told` is called with each new revision, from the
  /// thread that published it; it must be quick.
  using Watch = std::shared_ptr<const std::function<void(Revision)>>;
  [[nodiscard]] Watch watch(std::function<void(Revision)> told);

  /// Prepares and publishes. Sessions that edit one shared scene wait for each other here.
  [[nodiscard]] Expected<Prepared> commit(const Transaction& transaction,
                                          std::optional<Revision> expected);
  /// Access is by tenant, not by session: forked and unpickled clients work on their parent's
  /// scenes.
  [[nodiscard]] bool seen_by(const Session& session) const { return session.tenant() == tenant; }

 private:
  friend class Scenes;
  void tell(Revision revision);

  std::mutex commit_mutex_;
  Charge entities_;  // guarded by commit_mutex_
  std::mutex mutex_;
  std::unordered_map<u64, std::shared_ptr<EditLog>> edits_;  // by session
  std::vector<std::weak_ptr<const std::function<void(Revision)>>> watches_;
};
using ScenePtr = std::shared_ptr<SceneEntry>;

struct NewScene {
  std::string name;
  bool is_shared = false;
  std::shared_ptr<const Snapshot> first;
};

/// Thread: any. A name is unique among the scenes that a session sees; what it does not see is
/// answered like what is not there.
class Scenes {
 public:
  struct Options {
    u32 limit = 4096;
    SceneLimits scene;
    ReplyLimits replies;
    u32 queue = 64;  // edits of one session and scene that may wait
  };
  Scenes(WorkPool& pool, Options options) : pool_(pool), options_(options) {}

  [[nodiscard]] Expected<ScenePtr> create(NewScene scene, const Session& session);
  [[nodiscard]] Expected<ScenePtr> find(u64 id, const Session& session) const;
  [[nodiscard]] Expected<ScenePtr> open(const std::string& name, const Session& session) const;
  [[nodiscard]] std::vector<ScenePtr> list(const Session& session) const;
  /// Every tenant's.
  [[nodiscard]] std::vector<ScenePtr> all() const;
  [[nodiscard]] Status remove(u64 id, const Session& session);
  /// Frees the session's private scenes and edit logs; the memory goes on the work pool.
  void end_session(u64 session);
  [[nodiscard]] std::shared_ptr<EditLog> edits(SceneEntry& scene, u64 session);
  /// The number this session's next edit must carry.
  [[nodiscard]] u64 next_edit(SceneEntry& scene, u64 session) const;
  [[nodiscard]] const SceneLimits& scene_limits() const { return options_.scene; }

 private:
  [[nodiscard]] ScenePtr named(const std::string& name, const Session& session) const;
  void free_later(std::vector<ScenePtr> scenes);

  WorkPool& pool_;
  const Options options_;
  mutable std::mutex mutex_;
  std::map<u64, ScenePtr> scenes_;
  u64 last_id_ = 0;
};

/// The revision asked for, or the head.
[[nodiscard]] Expected<std::shared_ptr<const Snapshot>> snapshot_at(
    const SceneEntry& scene, std::optional<Revision> revision);

}  // namespace heliograph::server
