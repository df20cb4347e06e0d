// Start times of work in progress.
#pragma once

#include <chrono>
#include <mutex>
#include <set>

namespace heliograph::server {

/// Set of the start times of work in progress. Thread: any.
class BusyTimes {
 public:
  using Clock = std::chrono::steady_clock;

  /// Counts as work in progress during its lifetime.
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

  /// Returns the age of the oldest work in progress, in seconds; 0: none.
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
