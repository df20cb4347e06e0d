// Allocator of ranges of a piece of memory. Used by arenas.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <utility>

#include "renderer/base/types.h"

namespace heliograph::server {

/// Free ranges of [0, size), best fit: cuts the smallest range that fits, the first of equal ones.
/// Neighbours join when they are given back. Each call takes O(log n) for n free ranges.
class Ranges {
 public:
  explicit Ranges(u64 size) { insert(0, size); }

  /// Takes a range of at least one byte; returns its offset, none where no free range is large
  /// enough.
  [[nodiscard]] std::optional<u64> take(u64 bytes);
  /// Gives back a range that take() returned.
  void give_back(u64 offset, u64 bytes);
  [[nodiscard]] std::size_t count() const { return free_.size(); }

 private:
  using Free = std::map<u64, u64>;  // offset -> bytes
  void insert(u64 offset, u64 bytes);
  void erase(Free::iterator range);

  Free free_;
  std::set<std::pair<u64, u64>> by_size_;  // (bytes, offset) of the same ranges
};

}  // namespace heliograph::server
