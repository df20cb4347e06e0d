// The newest transactions of a scene, as Watch sends them. Filled by commits and by recovery.
#pragma once

#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "renderer/scene/snapshot.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// Limits of kept transactions: count and bytes.
struct EventLimits {
  u64 events = 16'384;
  u64 bytes = 16ull << 20;
};

/// Events of consecutive revisions up to the head. The oldest are dropped at the limits, or when
/// the owner's budget is used up. Thread: any; one mutex, held for microseconds.
class SceneEvents {
 public:
  using Event = std::shared_ptr<const std::string>;  // a serialised v1::WatchReply

  /// Events of a scene at `head`. budget: bytes of its owner.
  SceneEvents(EventLimits limits, std::shared_ptr<Budget> budget, Revision head);

  /// Returns true once keep() was called; until then no event is kept.
  [[nodiscard]] bool is_kept() const;
  void keep();

  /// The scene advanced to `revision`. event: null when events are not kept.
  void add(Revision revision, Event event);
  [[nodiscard]] Revision head() const;
  /// Returns the event of a revision; null: the next one, which does not exist yet. OUT_OF_RANGE
  /// when it is no longer kept, or beyond the next one; `expected` is the nearest available
  /// revision.
  [[nodiscard]] Expected<Event> at(Revision revision) const;
  /// Returns the kept events up to `last`, oldest first.
  [[nodiscard]] std::vector<Event> list(Revision last) const;

 private:
  [[nodiscard]] Revision oldest() const { return head_ + 1 - events_.size(); }  // under mutex_
  [[nodiscard]] Event forget_oldest();

  const EventLimits limits_;
  mutable std::mutex mutex_;
  Revision head_;
  bool is_kept_ = false;
  std::deque<Event> events_;  // the last one is of head_
  u64 bytes_ = 0;
  Charge charge_;
};

}  // namespace heliograph::server
