// Changes of scenes that no journal keeps, and the moment after which there are none. Used by
// scenes.cpp and service_edit.cpp.
#pragma once

#include <atomic>
#include <utility>

#include "server/session/session.h"

namespace heliograph::server {

/// Thread: any. A change may begin within another one.
class Changes {
 public:
  /// One that is under way, up to its acknowledgement.
  class Change {
   public:
    explicit Change(std::atomic<u32>& count) : count_(&count) {}
    Change(Change&& other) noexcept : count_(std::exchange(other.count_, nullptr)) {}
    Change& operator=(Change&&) = delete;
    ~Change() {
      if (count_ && --*count_ == 0) count_->notify_all();
    }

   private:
    std::atomic<u32>* count_;
  };

  /// UNAVAILABLE, with a retry time, after stop(): nothing may change, and nobody is told that it
  /// did.
  [[nodiscard]] Expected<Change> begin() {
    ++count_;
    Change change(count_);  // counted before it asks, so that stop() waits or is seen
    if (is_stopped_) return shutting_down();
    return change;
  }
  /// No change begins from now on; returns when those under way are done.
  void stop() {
    is_stopped_ = true;
    for (u32 left = count_; left != 0; left = count_) count_.wait(left);
  }

 private:
  std::atomic<u32> count_ = 0;
  std::atomic<bool> is_stopped_ = false;
};

}  // namespace heliograph::server
