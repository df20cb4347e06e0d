// See ranges.h.
#include "server/store/ranges.h"

#include <cassert>
#include <iterator>

namespace heliograph::server {

void Ranges::insert(u64 offset, u64 bytes) {
  free_.emplace(offset, bytes);
  by_size_.emplace(bytes, offset);
}

void Ranges::erase(Free::iterator range) {
  by_size_.erase({range->second, range->first});
  free_.erase(range);
}

std::optional<u64> Ranges::take(u64 bytes) {
  assert(bytes > 0);
  const auto found = by_size_.lower_bound({bytes, 0});
  if (found == by_size_.end()) return std::nullopt;
  const auto [size, offset] = *found;
  erase(free_.find(offset));
  if (size > bytes) insert(offset + bytes, size - bytes);
  return offset;
}

void Ranges::give_back(u64 offset, u64 bytes) {
  const auto next = free_.lower_bound(offset);
  assert(next == free_.end() || next->first >= offset + bytes);
  if (next != free_.begin()) {
    const auto before = std::prev(next);
    assert(before->first + before->second <= offset);
    if (before->first + before->second == offset) {
      offset = before->first;
      bytes += before->second;
      erase(before);
    }
  }
  if (next != free_.end() && next->first == offset + bytes) {
    bytes += next->second;
    erase(next);
  }
  insert(offset, bytes);
}

}  // namespace heliograph::server
