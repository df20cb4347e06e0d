// Decodes, and reading for them, that wait for a process: tenants take turns, and none has all
// processes. Filled by Decoder, emptied by its threads.
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
  std::function<void()> read = nullptr;  // in place of a decode; `done` is told a refusal only
};

/// Thread: any.
class DecodeQueue {
 public:
  struct Limits {
    u64 running = 3;    // decodes of one tenant at a time
    u64 waiting = 256;  // of one tenant
  };
  explicit DecodeQueue(Limits limits) : limits_(limits) {}

  /// RESOURCE_EXHAUSTED when as many of its tenant wait as may; the task is as it was then.
  [[nodiscard]] Status push(DecodeTask& task);
  /// The oldest task of the tenant whose turn it is; waits for one. nullopt: a stop was requested.
  [[nodiscard]] std::optional<DecodeTask> take(const std::stop_token& stop);
  /// One that was taken has ended.
  void end(u64 tenant);
  /// What nobody took.
  [[nodiscard]] std::vector<DecodeTask> rest();

 private:
  struct Lane {
    std::deque<DecodeTask> waiting;
    u64 running = 0;
  };
  using Lanes = std::map<u64, Lane>;  // by tenant; those that have any
  [[nodiscard]] Lanes::iterator next();

  const Limits limits_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  Lanes lanes_;
  u64 last_ = 0;  // the tenant whose turn it was
};

}  // namespace heliograph::server
