// Threads for work that is too long for a gRPC thread: checking arrays, building jobs, reading,
// freeing.
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

constexpr double kBusySeconds = 0.1;  // retry time of a refused call

/// Returns RESOURCE_EXHAUSTED with that retry time. limit: the name of the limit reached.
[[nodiscard]] std::unexpected<Error> busy(std::string message, std::string limit = "");

/// Owns: its threads. Round robin among tenants, one task each. The queue is bounded; tasks beyond
/// it are refused. Thread: any.
class WorkPool {
 public:
  using Task = std::function<void()>;
  static constexpr u64 kDaemon = ~u64(0);  // pseudo-tenant of the daemon's own tasks

  WorkPool(u32 threads, u32 capacity);
  ~WorkPool() { stop(); }

  /// Runs the queued tasks, then ends the threads. Tasks posted later never run.
  void stop();
  /// Queues a task. RESOURCE_EXHAUSTED when the tenant has as many tasks waiting as the queue has
  /// room left: a lone tenant may fill half of it, and others always find room.
  [[nodiscard]] Status post(u64 tenant, Task task);
  /// Returns how long tasks have waited without one beginning, in seconds; 0: none waits.
  [[nodiscard]] double still_seconds() const;

 private:
  void push(u64 tenant, Task task);  // under mutex_
  [[nodiscard]] Task next();         // under mutex_
  friend class Strand;
  void post_anyway(u64 tenant, Task task);  // for strands, whose own queues are bounded
  void work();

  const u32 capacity_;
  mutable std::mutex mutex_;
  std::condition_variable ready_;
  std::map<u64, std::deque<Task>> tasks_;        // by tenant; none is empty
  std::deque<u64> turns_;                        // tenants with tasks, the next one first
  std::size_t waiting_ = 0;                      // tasks
  std::chrono::steady_clock::time_point moved_;  // when a task last began, or the first one arrived
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

/// Runs a tenant's tasks one at a time, in order, on a pool. Kept alive by its tasks. Thread: any.
class Strand : public std::enable_shared_from_this<Strand> {
 public:
  Strand(WorkPool& pool, u64 tenant, u32 capacity)
      : pool_(pool), tenant_(tenant), capacity_(capacity) {}

  /// Runs a task: a short one in the caller when none is queued before it. RESOURCE_EXHAUSTED when
  /// the queue is full.
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
