// What waits for the journal's writer, in a fair order of tenants. Used by journal.cpp.
#pragma once

#include <algorithm>
#include <deque>
#include <iterator>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph::server {

/// Start-time fair queuing by bytes (Goyal, Vin and Cheng 1996): the tenant that had the fewest
/// goes first, in a tenant whoever came first. Thread: one at a time.
template <class T>
class WriteQueue {
 public:
  void push(const std::string& tenant, u64 bytes, T item) {
    Line& line = lines_[tenant];
    if (line.items.empty()) line.had = std::max(line.had, reached_);
    line.items.emplace_back(bytes, std::move(item));
    ++size_;
  }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t size_of(const std::string& tenant) const {
    const auto line = lines_.find(tenant);
    return line == lines_.end() ? 0 : line->second.items.size();
  }

  /// The next ones, `most` bytes together; the first one whatever it has.
  [[nodiscard]] std::vector<T> take(u64 most) {
    std::vector<T> taken;
    u64 bytes = 0;
    for (Line* line = next(); line; line = next()) {
      auto& [size, item] = line->items.front();
      bytes += size;
      if (!taken.empty() && bytes > most) break;
      reached_ = line->had;
      line->had += size;
      taken.push_back(std::move(item));
      line->items.pop_front();
      --size_;
    }
    return taken;
  }
  [[nodiscard]] std::vector<T> take_all() {
    std::vector<T> taken;
    for (auto& [tenant, line] : lines_)
      for (auto& [size, item] : std::exchange(line.items, {})) taken.push_back(std::move(item));
    size_ = 0;
    return taken;
  }

 private:
  struct Line {
    std::deque<std::pair<u64, T>> items;
    u64 had = 0;  // bytes, or what it starts from
  };
  [[nodiscard]] Line* next() {
    Line* first = nullptr;
    for (auto& [tenant, line] : lines_)
      if (!line.items.empty() && (!first || line.had < first->had)) first = &line;
    return first;
  }

  std::map<std::string, Line> lines_;
  u64 reached_ = 0;
  std::size_t size_ = 0;
};

}  // namespace heliograph::server
