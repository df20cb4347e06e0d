// What a scene takes of its tenant's ledger. Owned by SceneEntry.
#pragma once

#include <deque>
#include <unordered_map>
#include <utility>
#include <vector>

#include "renderer/scene/scene.h"
#include "server/quota/ledger.h"

namespace heliograph::server {

/// Charges for a scene, its objects, their names, attributes, keys and the like, and what its older
/// revisions keep besides. Arrays have charges of their own. Thread: one at a time.
class SceneCharges {
 public:
  [[nodiscard]] static Expected<SceneCharges> take(const Ledger& ledger, const Snapshot& first);

  /// For a revision that was prepared from `before`. When that fails nothing changed.
  [[nodiscard]] Status add(const Snapshot& before, const Transaction& transaction,
                           const Prepared& prepared);
  /// Revisions from `first` on were dropped: `last` is the newest.
  void drop(Revision first, const Snapshot& last);
  /// Revisions up to this one are no longer kept.
  void forget(Revision last);

 private:
  struct Change {
    std::vector<std::pair<u64, u64>> sizes;  // entity, bytes
    bool has_removed = false;
  };
  /// Replaced by a revision; the one before it keeps it.
  struct Kept {
    Revision by = 0;
    u64 bytes = 0;
  };
  SceneCharges(Charge scene, Charge entities, Charge bytes)
      : scene_(std::move(scene)), entities_(std::move(entities)), bytes_(std::move(bytes)) {}
  [[nodiscard]] static Change change_of(const Transaction& transaction, const Prepared& prepared);
  [[nodiscard]] u64 bytes(const Snapshot& head) const;
  void set_size(u64 entity, u64 size);
  u64 forget_removed(const Snapshot& head);

  Charge scene_;
  Charge entities_;
  Charge bytes_;
  std::unordered_map<u64, u64> sizes_;  // of entities, beyond what each counts in any case
  u64 size_ = 0;                        // their sum
  std::deque<Kept> kept_;               // the oldest first
  u64 kept_bytes_ = 0;                  // their sum
};

}  // namespace heliograph::server
