// Ends calls that stall: each registered call is checked twice per second.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "server/os/event_loop.h"

namespace heliograph::server {

/// A monitored call in flight. on_tick() may use the call's context, which gRPC frees after OnDone:
/// OnDone calls end_ticks() first.
class Monitored {
 public:
  virtual ~Monitored() = default;
  /// Runs on_tick(), unless ticks have ended.
  void run_tick(EventLoop::Clock::time_point now) {
    const std::lock_guard lock(tick_mutex_);
    if (!has_ended_) on_tick(now);
  }

 protected:
  /// Ends ticks, and waits for one that another thread runs. Called with no lock held.
  void end_ticks() {
    const std::lock_guard lock(tick_mutex_);
    has_ended_ = true;
  }

 private:
  /// Checks the call. Thread: the event loop's. Must not block.
  virtual void on_tick(EventLoop::Clock::time_point now) = 0;

  std::recursive_mutex tick_mutex_;  // recursive: a call may end within its own tick
  bool has_ended_ = false;
};

/// Ticks every registered call. The event loop must outlive it. Thread: any.
class StallMonitor {
 public:
  /// Starts the ticks. Called once, before the loop runs.
  void start(EventLoop& loop);
  /// Registers a call until it is destroyed.
  void add(std::weak_ptr<Monitored> call);

 private:
  void tick();

  EventLoop* loop_ = nullptr;
  std::mutex mutex_;
  std::vector<std::weak_ptr<Monitored>> calls_;
};

/// Time since a reader last took something of what waits for it. Thread: one at a time.
class Standstill {
 public:
  using Clock = EventLoop::Clock;

  /// Restarts the time: something was taken, or the first item waits.
  void moved() { since_ = Clock::now(); }
  [[nodiscard]] bool is_longer_than(double seconds, Clock::time_point now) const {
    return std::chrono::duration<double>(now - since_).count() > seconds;
  }

 private:
  Clock::time_point since_ = Clock::now();
};

}  // namespace heliograph::server
