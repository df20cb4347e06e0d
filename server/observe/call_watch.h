// Looks after calls that may come to a standstill: twice a second each is asked to see to itself.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "server/os/event_loop.h"

namespace heliograph::server {

/// A call in flight. A look may use its context: OnDone, after which gRPC frees that, ends looks.
class Watched {
 public:
  virtual ~Watched() = default;
  /// Looks, unless looks have ended.
  void look_at(EventLoop::Clock::time_point now) {
    const std::lock_guard lock(looking_);
    if (!has_ended_) look(now);
  }

 protected:
  /// Waits for the look that another thread takes; none follows. Called with no lock held.
  void end_looks() {
    const std::lock_guard lock(looking_);
    has_ended_ = true;
  }

 private:
  /// Thread: the event loop. Must not block.
  virtual void look(EventLoop::Clock::time_point now) = 0;

  std::recursive_mutex looking_;  // of a call that ends within its look, in the look's thread
  bool has_ended_ = false;
};

/// Thread: any. The event loop must outlive its use.
class CallWatch {
 public:
  /// Begins to look. Called once, before the loop runs.
  void start(EventLoop& loop);
  /// Looks after it until it is gone.
  void add(std::weak_ptr<Watched> call);

 private:
  void look();

  EventLoop* loop_ = nullptr;
  std::mutex mutex_;
  std::vector<std::weak_ptr<Watched>> calls_;
};

/// How long a reader has taken nothing of what waits for it. Thread: one at a time.
class Standstill {
 public:
  using Clock = EventLoop::Clock;

  /// Something was taken, or the first thing waits.
  void moved() { since_ = Clock::now(); }
  [[nodiscard]] bool is_longer_than(double seconds, Clock::time_point now) const {
    return std::chrono::duration<double>(now - since_).count() > seconds;
  }

 private:
  Clock::time_point since_ = Clock::now();
};

}  // namespace heliograph::server
