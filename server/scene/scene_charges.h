// Charges of a scene to its tenant's ledger. Owned by SceneEntry.
#pragma once

#include <deque>
#include <unordered_map>
#include <utility>
#include <vector>

#include "renderer/scene/scene.h"
#include "server/quota/ledger.h"

namespace heliograph::server {

/// Charges for a scene: its objects with their names, attributes and keys, and what its older
/// revisions keep beyond the head. Arrays have charges of their own. Thread: one at a time.
class SceneCharges {
 public:
  [[nodiscard]] static Expected<SceneCharges> take(const Ledger& ledger, const Snapshot& first);

  /// Charges a revision prepared from `before`. Changes nothing on failure.
  [[nodiscard]] Status add(const Snapshot& before, const Transaction& transaction,
                           const Prepared& prepared);
  /// Releases the revisions from `first` on, which were dropped; `last` is the newest that remains.
  void drop(Revision first, const Snapshot& last);
  /// Releases the revisions up to `last`, which are no longer kept.
  void forget(Revision last);

 private:
  struct Change {
    std::vector<std::pair<u64, u64>> sizes;  // entity, bytes
    bool has_removed = false;
  };
  /// Bytes that a replaced revision keeps alive.
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
  std::unordered_map<u64, u64> sizes_;  // by entity: bytes beyond kEntityBytes
  u64 size_ = 0;                        // sum of sizes_
  std::deque<Kept> kept_;               // oldest first
  u64 kept_bytes_ = 0;                  // sum of kept_
};

}  // namespace heliograph::server
