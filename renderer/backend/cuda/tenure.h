// How long a context is there.
#pragma once

#include <mutex>
#include <shared_mutex>

namespace heliograph::cuda {

/// Held by other threads than the device's while they ask something of the driver. Thread: any.
class Tenure {
 public:
  /// Owns nothing when it is over.
  [[nodiscard]] std::shared_lock<std::shared_mutex> hold() {
    std::shared_lock lock(mutex_);
    if (is_over_) lock.unlock();
    return lock;
  }
  /// Waits for who holds it.
  void end() {
    const std::unique_lock lock(mutex_);
    is_over_ = true;
  }

 private:
  std::shared_mutex mutex_;
  bool is_over_ = false;
};

}  // namespace heliograph::cuda
