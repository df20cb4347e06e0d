// The newest transactions of a scene, as Watch sends them. Filled by its commits and by recovery.
#pragma once

#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "renderer/scene/snapshot.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// How many transactions are kept, and how many bytes of them.
struct EventLimits {
  u64 events = 16'384;
  u64 bytes = 16ull << 20;
};

/// One event for each revision, without gaps, up to the head. The oldest go when the limits are
/// reached, or the owner's bytes are. Thread: any; one mutex, held for microseconds.
class SceneEvents {
 public:
  using Event = std::shared_ptr<const std::string>;  // a serialised v1::WatchReply

  /// Of a scene at `head`. `budget`: of its owner's bytes.
  SceneEvents(EventLimits limits, std::shared_ptr<Budget> budget, Revision head);

  /// Whether events are kept; until keep() they are not.
  [[nodiscard]] bool is_kept() const;
  void keep();

  /// The scene went on to `revision`. `event`: null when events are not kept.
  void add(Revision revision, Event event);
  [[nodiscard]] Revision head() const;
  /// Null: the next one, which is not there yet. OUT_OF_RANGE, with the nearest revision that can
  /// be had as `expected`: it is no longer kept, or not the next one.
  [[nodiscard]] Expected<Event> at(Revision revision) const;
  /// Those that are kept, up to `last`, oldest first.
  [[nodiscard]] std::vector<Event> list(Revision last) const;

 private:
  [[nodiscard]] Revision oldest() const { return head_ + 1 - events_.size(); }  // under mutex_
  [[nodiscard]] Event forget_oldest();

  const EventLimits limits_;
  mutable std::mutex mutex_;
  Revision head_;
  bool is_kept_ = false;
  std::deque<Event> events_;  // the last one made head_
  u64 bytes_ = 0;
  Charge charge_;
};

}  // namespace heliograph::server
