// Which bytes of a piece of memory are free. Used by arenas.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <utility>

#include "renderer/base/types.h"

namespace heliograph::server {

/// The free ranges of [0, size), best fit: the smallest that will do is cut, of equal ones the
/// first. Neighbours join when they are given back. Each call takes O(log n) for n free ranges.
class Ranges {
 public:
  explicit Ranges(u64 size) { insert(0, size); }

  /// The offset of so many bytes, at least one; none where no free range has as many.
  [[nodiscard]] std::optional<u64> take(u64 bytes);
  /// What take() gave.
  void give_back(u64 offset, u64 bytes);
  [[nodiscard]] std::size_t count() const { return free_.size(); }

 private:
  using Free = std::map<u64, u64>;  // offset -> bytes
  void insert(u64 offset, u64 bytes);
  void erase(Free::iterator range);

  Free free_;
  std::set<std::pair<u64, u64>> by_size_;  // (bytes, offset) of the same
};

}  // namespace heliograph::server
