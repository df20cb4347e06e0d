// Threads for what is too long for a gRPC thread: checking arrays, building jobs, reading, freeing.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "renderer/base/error.h"

namespace heliograph::server {

constexpr double kBusySeconds = 0.1;  // after which a call that was one too many may come again

/// RESOURCE_EXHAUSTED, with that. `limit`: the one that is in the way.
[[nodiscard]] std::unexpected<Error> busy(std::string message, std::string limit = "");

/// Owns: its threads. Tenants take turns, a task each. Thread: any. The queue is bounded; what does
/// not fit is refused.
class WorkPool {
 public:
  using Task = std::function<void()>;
  static constexpr u64 kDaemon = ~u64(0);  // whose own tasks have a turn and a part like a tenant's

  WorkPool(u32 threads, u32 capacity);
  ~WorkPool() { stop(); }

  /// Runs what is queued, then ends the threads. What is posted later never runs.
  void stop();
  /// RESOURCE_EXHAUSTED when as many of the tenant's wait as there is room left in the queue: one
  /// that is alone has half of it, and others always find room.
  [[nodiscard]] Status post(u64 tenant, Task task);
  /// How long nothing of what waits was begun; 0: nothing waits.
  [[nodiscard]] double still_seconds() const;

 private:
  void push(u64 tenant, Task task);  // under mutex_
  [[nodiscard]] Task next();         // the same
  friend class Strand;
  void post_anyway(u64 tenant, Task task);  // for strands, whose own queues are bounded
  void work();

  const u32 capacity_;
  mutable std::mutex mutex_;
  std::condition_variable ready_;
  std::map<u64, std::deque<Task>> tasks_;        // by tenant; of those that have any
  std::deque<u64> turns_;                        // these tenants, the next one first
  std::size_t waiting_ = 0;                      // tasks
  std::chrono::steady_clock::time_point moved_;  // the last one was begun, or the first one waits
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

/// Runs a tenant's tasks one after another, in order, on a pool. Thread: any. Kept alive by its
/// tasks.
class Strand : public std::enable_shared_from_this<Strand> {
 public:
  Strand(WorkPool& pool, u64 tenant, u32 capacity)
      : pool_(pool), tenant_(tenant), capacity_(capacity) {}

  /// A short task runs in the caller when nothing is before it. RESOURCE_EXHAUSTED when the queue
  /// is full.
  [[nodiscard]] Status run(WorkPool::Task task, bool is_short);

 private:
  void drain();
  void post_drain();

  WorkPool& pool_;
  const u64 tenant_;
  const u32 capacity_;
  std::mutex mutex_;
  std::deque<WorkPool::Task> tasks_;
  bool busy_ = false;
};

}  // namespace heliograph::server
