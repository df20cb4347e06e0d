// Queue of decodes and their file reads, fair among tenants; no tenant gets all processes. Filled
// by Decoder, emptied by its threads.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <stop_token>
#include <vector>

#include "server/decode/decoder.h"

namespace heliograph::server {

struct DecodeTask {
  DecodeJob job;
  std::function<void(Expected<Decoded>)> done;
  std::stop_token stop;
  std::function<void()> read = nullptr;  // instead of a decode; `done` is called only when refused
};

/// Round robin among tenants. Thread: any.
class DecodeQueue {
 public:
  struct Limits {
    u64 running = 3;    // concurrent decodes per tenant
    u64 waiting = 256;  // waiting tasks per tenant
  };
  explicit DecodeQueue(Limits limits) : limits_(limits) {}

  /// Queues a task. RESOURCE_EXHAUSTED when too many of its tenant wait; the task is unchanged
  /// then.
  [[nodiscard]] Status push(DecodeTask& task);
  /// Waits for and takes the oldest task of the tenant whose turn it is. nullopt: a stop was
  /// requested.
  [[nodiscard]] std::optional<DecodeTask> take(const std::stop_token& stop);
  /// Reports the end of a taken task.
  void end(u64 tenant);
  /// Returns the tasks that were not taken.
  [[nodiscard]] std::vector<DecodeTask> rest();

 private:
  struct Lane {
    std::deque<DecodeTask> waiting;
    u64 running = 0;
  };
  using Lanes = std::map<u64, Lane>;  // by tenant; none is empty
  [[nodiscard]] Lanes::iterator next();

  const Limits limits_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  Lanes lanes_;
  u64 last_ = 0;  // the tenant whose turn it was
};

}  // namespace heliograph::server
