// Applying transactions: all or nothing, as a pure function, and the chain of revisions it makes.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "renderer/scene/snapshot.h"
#include "renderer/scene/transaction.h"

namespace heliograph {

/// Result that a transaction would have on a snapshot. Not visible to anybody yet.
struct Prepared {
  std::shared_ptr<const Snapshot> snapshot;
  std::vector<Id> ids;      // one an edit, then the further ids of each edit in order
  std::vector<u32> counts;  // further ids of each edit (Instances, Instantiate)
};

struct SceneLimits {
  u32 entities = 4'000'000;
  u64 array_bytes = 8ull << 30;  // of all arrays a scene refers to, shared ones counted once
  u32 revisions = 64;            // recent revisions kept for RenderRequest.revision
};

/// Applies every edit or none.
///
/// Fails with, `where` = "edits[i]..." : NOT_FOUND (stale id, unknown name with the nearest ones),
/// ALREADY_EXISTS (mode CREATE), INVALID_ARGUMENT (mesh and volume on one entity, a label on
/// unrelated entities without `group`, a parent cycle, a reference of the wrong kind, vertices that
/// do not match the topology, a skin without joints), FAILED_PRECONDITION (removal of something in
/// use; lists its users), RESOURCE_EXHAUSTED (limits). The new revision is base.revision + 1.
[[nodiscard]] Expected<Prepared> apply(const Snapshot& base, const Transaction& transaction,
                                       const SceneLimits& limits);

/// A scene: its head and its recent revisions.
///
/// Thread: any; one mutex, held for microseconds: a transaction is applied outside it, and again
/// when another one was faster. `prepare` and `publish` are two steps so that a
/// journal can commit between them; prepared transactions are published in the order of
/// preparation.
class Scene {
 public:
  /// Its snapshots are marked as of this scene, whoever made the first.
  Scene(const std::shared_ptr<const Snapshot>& first, SceneLimits limits);

  /// Applies to the pending head. `expected`: ABORTED unless it equals the pending revision.
  [[nodiscard]] Expected<Prepared> prepare(const Transaction& transaction,
                                           std::optional<Revision> expected);
  /// Makes the oldest prepared transaction the head. Returns revisions that are no longer kept:
  /// to free a large one takes a while.
  std::vector<std::shared_ptr<const Snapshot>> publish(const Prepared& prepared);
  /// Drops what was prepared and not published (a journal failed), from `first` on.
  void drop_pending(Revision first = 0);

  [[nodiscard]] std::shared_ptr<const Snapshot> head() const;
  /// The last one prepared, or the head: what the next transaction is applied to.
  [[nodiscard]] std::shared_ptr<const Snapshot> pending() const;
  /// OUT_OF_RANGE when it is no longer kept, or does not exist yet.
  [[nodiscard]] Expected<std::shared_ptr<const Snapshot>> at(Revision revision) const;

 private:
  [[nodiscard]] const std::shared_ptr<const Snapshot>& last() const;  // under mutex_

  const SceneLimits limits_;
  const std::shared_ptr<const SceneLife> life_ = std::make_shared<const SceneLife>();
  mutable std::mutex mutex_;
  std::deque<std::shared_ptr<const Snapshot>> pending_;  // prepared, oldest first
  std::deque<std::shared_ptr<const Snapshot>> recent_;   // the last is the head
};

/// Contents of a scene file: all that rebuild() needs to make a snapshot again.
struct SceneDescription {
  /// The edits that make it from an empty scene: the same objects in the same order, names, labels,
  /// classes, keys, settings and time. Objects without a name get none; references are
  /// CreatedByEdit. What is new since the last Advance, or jumped since, is put with `teleport`.
  Transaction scene;
  /// The edits that make of that the state before the last Advance, as far as motion reads it.
  /// Targets are CreatedByEdit of `scene`. Without edits: there was no Advance.
  Transaction previous;
  struct KeptLibrary {
    std::string asset;                      // hash
    std::vector<std::optional<u32>> edits;  // of `scene` that make its objects; nullopt: gone since
  };
  std::vector<KeptLibrary> libraries;  // ordered by hash
};
[[nodiscard]] SceneDescription describe(const Snapshot& snapshot);
using TakeEdit = std::function<void(Edit)>;
/// The same, but for `scene`: its edits go to `take` one by one, and so need no room.
[[nodiscard]] SceneDescription describe(const Snapshot& snapshot, const TakeEdit& take);

/// The snapshot of a description, at revision 1. Fails as apply() does, with `where` beneath
/// "transaction", "previous" or "libraries[i]"; INVALID_ARGUMENT when the parts do not fit
/// together.
[[nodiscard]] Expected<std::shared_ptr<const Snapshot>> rebuild(const SceneDescription& description,
                                                                const SceneLimits& limits);

/// Bytes of arrays a snapshot refers to, each counted once.
[[nodiscard]] u64 array_bytes(const Snapshot& snapshot);

}  // namespace heliograph
