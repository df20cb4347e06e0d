// The latest of what is shared, kept for who asks again.
#pragma once

#include <algorithm>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph::cuda {

/// Thread: any. Nothing is destroyed under its lock.
template <class T>
class Recent {
 public:
  using Ptr = std::shared_ptr<const T>;
  enum class Until : u8 {
    kDropped,    // by drop() or drop_unused()
    kOthersCame  // or dropped: by then `most` later ones of this kind
  };

  /// most   entries of kOthersCame
  explicit Recent(std::size_t most) : most_(most) {}

  /// The latest that is_it() is true of, which is the latest of all from now on; null: there is
  /// none.
  template <class F>
  [[nodiscard]] Ptr find(F&& is_it) {
    const std::lock_guard lock(mutex_);
    const auto after = std::find_if(kept_.rbegin(), kept_.rend(), [&](const Entry& each) {
                         return is_it(*each.ptr);
                       }).base();
    if (after == kept_.begin()) return nullptr;
    std::rotate(after - 1, after, kept_.end());
    return kept_.back().ptr;
  }

  /// As the latest. Where there are too many, the oldest goes to the caller.
  Ptr keep(Ptr newest, Until until) {
    Ptr dropped;
    const std::lock_guard lock(mutex_);
    std::erase_if(kept_, [&](const Entry& each) { return each.ptr == newest; });
    const auto counts = [](const Entry& each) { return each.until == Until::kOthersCame; };
    if (until == Until::kOthersCame && std::size_t(std::ranges::count_if(kept_, counts)) >= most_)
      dropped = take(std::ranges::find_if(kept_, counts));
    kept_.push_back({std::move(newest), until});
    return dropped;
  }

  /// Drops the one that is_it() is true of, if it is there; it goes to the caller.
  template <class F>
  Ptr drop(F&& is_it) {
    const std::lock_guard lock(mutex_);
    return take(std::ranges::find_if(kept_, [&](const Entry& each) { return is_it(*each.ptr); }));
  }

  /// Drops the oldest that nobody else holds; false: there is none.
  bool drop_unused() {
    Ptr dropped;
    const std::lock_guard lock(mutex_);
    dropped = take(
        std::ranges::find_if(kept_, [](const Entry& each) { return each.ptr.use_count() == 1; }));
    return dropped != nullptr;
  }

 private:
  struct Entry {
    Ptr ptr;
    Until until;
  };
  /// Null at the end.
  Ptr take(typename std::vector<Entry>::iterator which) {
    if (which == kept_.end()) return nullptr;
    Ptr taken = std::move(which->ptr);
    kept_.erase(which);
    return taken;
  }

  const std::size_t most_;
  std::mutex mutex_;
  std::vector<Entry> kept_;  // the last is the latest
};

}  // namespace heliograph::cuda
