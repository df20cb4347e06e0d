// The latest of what is shared, kept for who asks again.
#pragma once

#include <algorithm>
#include <memory>
#include <mutex>
#include <vector>

namespace heliograph::cuda {

/// Thread: any. Nothing is destroyed under its lock.
template <class T>
class Recent {
 public:
  using Ptr = std::shared_ptr<const T>;

  explicit Recent(std::size_t most) : most_(most) {}

  /// The latest that is_it() is true of, which is the latest of all from now on; null: there is
  /// none.
  template <class F>
  [[nodiscard]] Ptr find(F&& is_it) {
    const std::lock_guard lock(mutex_);
    const auto after = std::find_if(kept_.rbegin(), kept_.rend(), [&](const Ptr& each) {
                         return is_it(*each);
                       }).base();
    if (after == kept_.begin()) return nullptr;
    std::rotate(after - 1, after, kept_.end());
    return kept_.back();
  }

  /// As the latest. Where there are too many, the oldest goes to the caller.
  Ptr keep(Ptr newest) {
    Ptr dropped;
    const std::lock_guard lock(mutex_);
    std::erase(kept_, newest);
    if (kept_.size() == most_) {
      dropped = std::move(kept_.front());
      kept_.erase(kept_.begin());
    }
    kept_.push_back(std::move(newest));
    return dropped;
  }

  /// Drops the oldest that nobody else holds; false: there is none.
  bool drop_unused() {
    Ptr dropped;
    const std::lock_guard lock(mutex_);
    const auto found =
        std::ranges::find_if(kept_, [](const Ptr& each) { return each.use_count() == 1; });
    if (found == kept_.end()) return false;
    dropped = std::move(*found);
    kept_.erase(found);
    return true;
  }

 private:
  const std::size_t most_;
  std::mutex mutex_;
  std::vector<Ptr> kept_;  // the last is the latest
};

}  // namespace heliograph::cuda
