// Values that most scenes are never asked for.
#pragma once

#include <atomic>
#include <mutex>
#include <optional>

#include "renderer/base/error.h"
#include "renderer/base/parallel.h"

namespace heliograph::resident {

/// A value that is made when it is first asked for, and then stays. Thread: any.
template <class T>
class Lazy {
 public:
  /// make() -> Expected<T>; where it fails, the next who asks tries again.
  template <class F>
  [[nodiscard]] Expected<const T*> get(F&& make) const {
    if (const T* value = made()) return value;
    const std::scoped_lock lock(mutex_);
    if (!value_) {
      auto value = run_alone(make);
      if (!value) return std::unexpected(std::move(value).error());
      value_ = *std::move(value);
      is_made_.store(true, std::memory_order_release);
    }
    return &*value_;
  }
  /// Null: nobody has asked.
  [[nodiscard]] const T* made() const {
    return is_made_.load(std::memory_order_acquire) ? &*value_ : nullptr;
  }

 private:
  mutable std::mutex mutex_;
  mutable std::optional<T> value_;  // by mutex_ until it is made
  mutable std::atomic<bool> is_made_ = false;
};

}  // namespace heliograph::resident
