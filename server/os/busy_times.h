// Who is at work, and for how long.
#pragma once

#include <chrono>
#include <mutex>
#include <set>

namespace heliograph::server {

/// When each of those at work began. Thread: any.
class BusyTimes {
 public:
  using Clock = std::chrono::steady_clock;

  /// Is at work while it lives.
  class Scope {
   public:
    explicit Scope(BusyTimes& times) : times_(times) {
      const std::lock_guard lock(times_.mutex_);
      began_ = times_.began_.insert(Clock::now());
    }
    ~Scope() {
      const std::lock_guard lock(times_.mutex_);
      times_.began_.erase(began_);
    }
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;

   private:
    BusyTimes& times_;
    std::multiset<Clock::time_point>::iterator began_;
  };

  /// How long the one that began first is at work; 0: nobody is.
  [[nodiscard]] double longest_seconds() const {
    const std::lock_guard lock(mutex_);
    if (began_.empty()) return 0;
    return std::chrono::duration<double>(Clock::now() - *began_.begin()).count();
  }

 private:
  mutable std::mutex mutex_;
  std::multiset<Clock::time_point> began_;
};

}  // namespace heliograph::server
