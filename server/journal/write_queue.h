// Queue of the journal's writer, fair among tenants. Used by journal.cpp.
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

/// Start-time fair queuing (Goyal, Vin and Cheng 1996) of a flow per tenant, with cost in bytes;
/// first in, first out within a tenant. Thread: one at a time.
template <class T>
class WriteQueue {
 public:
  void push(const std::string& tenant, u64 bytes, T item) {
    Flow& flow = flows_[tenant];
    if (flow.items.empty()) flow.start_tag = std::max(flow.start_tag, virtual_time_);
    flow.items.emplace_back(bytes, std::move(item));
    ++size_;
  }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t size_of(const std::string& tenant) const {
    const auto flow = flows_.find(tenant);
    return flow == flows_.end() ? 0 : flow->second.items.size();
  }

  /// Takes the next items, `most` bytes in total, and at least one.
  [[nodiscard]] std::vector<T> take(u64 most) {
    std::vector<T> taken;
    u64 bytes = 0;
    for (Flow* flow = next(); flow; flow = next()) {
      auto& [size, item] = flow->items.front();
      bytes += size;
      if (!taken.empty() && bytes > most) break;
      virtual_time_ = flow->start_tag;
      flow->start_tag += size;
      taken.push_back(std::move(item));
      flow->items.pop_front();
      --size_;
    }
    return taken;
  }
  [[nodiscard]] std::vector<T> take_all() {
    std::vector<T> taken;
    for (auto& [tenant, flow] : flows_)
      for (auto& [size, item] : std::exchange(flow.items, {})) taken.push_back(std::move(item));
    size_ = 0;
    return taken;
  }

 private:
  struct Flow {
    std::deque<std::pair<u64, T>> items;
    u64 start_tag = 0;  // bytes: virtual time at which the next item starts
  };
  /// The waiting flow with the smallest start tag; null: none waits.
  [[nodiscard]] Flow* next() {
    Flow* first = nullptr;
    for (auto& [tenant, flow] : flows_)
      if (!flow.items.empty() && (!first || flow.start_tag < first->start_tag)) first = &flow;
    return first;
  }

  std::map<std::string, Flow> flows_;
  u64 virtual_time_ = 0;  // bytes: start tag of the item taken last
  std::size_t size_ = 0;
};

}  // namespace heliograph::server
