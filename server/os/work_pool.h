// Threads for what is too long for a gRPC thread: checking arrays, building jobs, reading, freeing.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "renderer/base/error.h"

namespace heliograph::server {

constexpr double kBusySeconds = 0.1;  // after which a call that was one too many may come again

/// RESOURCE_EXHAUSTED, with that. `limit`: the one that is in the way.
[[nodiscard]] std::unexpected<Error> busy(std::string message, std::string limit = "");

/// Owns: its threads. Thread: any. The queue is bounded; what does not fit is refused.
class WorkPool {
 public:
  using Task = std::function<void()>;

  WorkPool(u32 threads, u32 capacity);
  ~WorkPool() { stop(); }

  /// Runs what is queued, then ends the threads. What is posted later never runs.
  void stop();
  /// RESOURCE_EXHAUSTED when the queue is full.
  [[nodiscard]] Status post(Task task);
  /// How long nothing of what waits was begun; 0: nothing waits.
  [[nodiscard]] double still_seconds() const;

 private:
  void push(Task task);  // under mutex_
  friend class Strand;
  void post_anyway(Task task);  // for strands, whose own queues are bounded
  void work();

  const u32 capacity_;
  mutable std::mutex mutex_;
  std::condition_variable ready_;
  std::deque<Task> tasks_;
  std::chrono::steady_clock::time_point moved_;  // the last one was begun, or the first one waits
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

/// Runs tasks one after another, in order, on a pool. Thread: any. Kept alive by its tasks.
class Strand : public std::enable_shared_from_this<Strand> {
 public:
  Strand(WorkPool& pool, u32 capacity) : pool_(pool), capacity_(capacity) {}

  /// A short task runs in the caller when nothing is before it. RESOURCE_EXHAUSTED when the queue
  /// is full.
  [[nodiscard]] Status run(WorkPool::Task task, bool is_short);

 private:
  void drain();

  WorkPool& pool_;
  const u32 capacity_;
  std::mutex mutex_;
  std::deque<WorkPool::Task> tasks_;
  bool busy_ = false;
};

}  // namespace heliograph::server
