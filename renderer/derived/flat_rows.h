// Chunked rows one after the other, for who needs them so. The memory is used again, and of what it
// had before only the chunks that differ are copied.
#pragma once

#include <algorithm>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "renderer/base/parallel.h"
#include "renderer/scene/table.h"

namespace heliograph::resident {

/// Makes contiguous copies, and keeps the memory of some that nobody uses. Copies may outlive it.
/// Thread: any.
template <class T>
class FlatRows {
 public:
  /// T[rows.size()], with the same rows.
  [[nodiscard]] std::shared_ptr<const T> copy(const ChunkedArray<T>& rows) const {
    std::unique_ptr<Flat> flat = shared_->take(rows);
    if (!flat) flat = std::make_unique<Flat>(rows.size());
    std::vector<u32> differ;
    for (u32 c = 0; c < rows.chunk_count(); ++c)
      if (!rows.shares(c, flat->of)) differ.push_back(c);
    parallel_for(differ.size(), [&](std::size_t i) {
      std::ranges::copy(rows.chunk(differ[i]),
                        flat->rows.get() + std::size_t(differ[i]) * ChunkedArray<T>::kRows);
    });
    flat->of = rows;
    const T* first = flat->rows.get();
    const auto give_back = [shared = std::weak_ptr(shared_), flat = flat.release()](const T*) {
      std::unique_ptr<Flat> unused(flat);
      if (const auto pool = shared.lock()) pool->keep(std::move(unused));
    };
    return {first, give_back};
  }
  /// Bytes of what nobody uses now.
  [[nodiscard]] u64 bytes() const { return shared_->bytes(); }

 private:
  struct Flat {
    explicit Flat(u32 size) : rows(std::make_unique_for_overwrite<T[]>(size)) {}
    std::unique_ptr<T[]> rows;
    ChunkedArray<T> of;  // what is in them
  };
  class Shared {
   public:
    /// The one that has the most chunks of these rows; null: none is as long.
    std::unique_ptr<Flat> take(const ChunkedArray<T>& rows) {
      const std::scoped_lock lock(mutex_);
      auto best = unused_.end();
      u32 most = 0;
      for (auto flat = unused_.begin(); flat != unused_.end(); ++flat) {
        if ((*flat)->of.size() != rows.size()) continue;
        u32 same = 1;
        for (u32 c = 0; c < rows.chunk_count(); ++c) same += rows.shares(c, (*flat)->of);
        if (same > most) best = flat, most = same;
      }
      if (best == unused_.end()) return nullptr;
      auto taken = std::move(*best);
      unused_.erase(best);
      return taken;
    }
    void keep(std::unique_ptr<Flat> flat) {
      std::unique_ptr<Flat> gone;  // without the lock
      const std::scoped_lock lock(mutex_);
      unused_.push_back(std::move(flat));
      if (unused_.size() <= kUnused) return;
      gone = std::move(unused_.front());
      unused_.erase(unused_.begin());
    }
    u64 bytes() const {
      const std::scoped_lock lock(mutex_);
      u64 sum = 0;
      for (const auto& flat : unused_) sum += flat->of.size() * sizeof(T);
      return sum;
    }

   private:
    static constexpr std::size_t kUnused = 2;
    mutable std::mutex mutex_;
    std::vector<std::unique_ptr<Flat>> unused_;  // the last is the latest
  };

  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
};

}  // namespace heliograph::resident
