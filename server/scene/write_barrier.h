// A barrier that ends writes to scenes without a journal, so that the daemon can save their last
// state. Used by scenes.cpp and service_edit.cpp.
#pragma once

#include <atomic>
#include <utility>

#include "server/session/session.h"

namespace heliograph::server {

/// Counts writes in flight; after stop() none begins. Writes may nest. Thread: any.
class WriteBarrier {
 public:
  /// A write in flight, until its acknowledgement is sent.
  class Write {
   public:
    explicit Write(std::atomic<u32>& count) : count_(&count) {}
    Write(Write&& other) noexcept : count_(std::exchange(other.count_, nullptr)) {}
    Write& operator=(Write&&) = delete;
    ~Write() {
      if (count_ && --*count_ == 0) count_->notify_all();
    }

   private:
    std::atomic<u32>* count_;
  };

  /// Begins a write. UNAVAILABLE with a retry time after stop(): the caller must neither change a
  /// scene nor acknowledge a change.
  [[nodiscard]] Expected<Write> begin() {
    ++count_;
    Write write(
        count_);  // counted before is_stopped_ is read: stop() waits for it, or it sees stop()
    if (is_stopped_) return shutting_down();
    return write;
  }
  /// Lets no further write begin; returns when those in flight have ended.
  void stop() {
    is_stopped_ = true;
    for (u32 left = count_; left != 0; left = count_) count_.wait(left);
  }

 private:
  std::atomic<u32> count_ = 0;
  std::atomic<bool> is_stopped_ = false;
};

}  // namespace heliograph::server
