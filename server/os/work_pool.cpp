// A bounded thread pool and its strands. Called by the RPC handlers.
#include "server/os/work_pool.h"

#include <fmt/format.h>

namespace heliograph::server {

std::unexpected<Error> busy(std::string message, std::string limit) {
  Error error{.code = Code::kResourceExhausted, .message = std::move(message), .where = ""};
  error.limit = std::move(limit);
  error.retry_seconds = kBusySeconds;
  return std::unexpected(std::move(error));
}

WorkPool::WorkPool(u32 threads, u32 capacity) : capacity_(capacity) {
  for (u32 i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

void WorkPool::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  ready_.notify_all();
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

Status WorkPool::post(Task task) {
  {
    const std::lock_guard lock(mutex_);
    if (tasks_.size() >= capacity_)
      return busy(
          fmt::format("{} requests wait already; retry later (limit pool_queue)", tasks_.size()),
          "pool_queue");
    push(std::move(task));
  }
  ready_.notify_one();
  return {};
}

void WorkPool::post_anyway(Task task) {
  {
    const std::lock_guard lock(mutex_);
    push(std::move(task));
  }
  ready_.notify_one();
}

void WorkPool::push(Task task) {
  if (tasks_.empty()) moved_ = std::chrono::steady_clock::now();
  tasks_.push_back(std::move(task));
}

double WorkPool::still_seconds() const {
  const std::lock_guard lock(mutex_);
  if (tasks_.empty()) return 0;
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - moved_).count();
}

void WorkPool::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    ready_.wait(lock, [this] { return stopping_ || !tasks_.empty(); });
    if (tasks_.empty()) return;
    Task task = std::move(tasks_.front());
    tasks_.pop_front();
    moved_ = std::chrono::steady_clock::now();
    lock.unlock();
    task();
    task = nullptr;  // what it holds is freed outside the lock
    lock.lock();
  }
}

Status Strand::run(WorkPool::Task task, bool is_short) {
  WorkPool::Task now;  // empty: it waits its turn
  {
    const std::lock_guard lock(mutex_);
    if (tasks_.size() >= capacity_)
      return busy(fmt::format("{} requests of this session and scene wait already; wait for their "
                              "replies (limit calls_per_session)",
                              tasks_.size()),
                  "calls_per_session");
    if (!busy_ && is_short)
      now = std::move(task);
    else
      tasks_.push_back(std::move(task));
    if (busy_) return {};
    busy_ = true;
  }
  if (now) now();
  bool more;
  {
    const std::lock_guard lock(mutex_);
    more = !tasks_.empty();
    if (!more) busy_ = false;
  }
  if (more) pool_.post_anyway([self = shared_from_this()] { self->drain(); });
  return {};
}

void Strand::drain() {
  while (true) {
    WorkPool::Task task;
    {
      const std::lock_guard lock(mutex_);
      if (tasks_.empty()) {
        busy_ = false;
        return;
      }
      task = std::move(tasks_.front());
      tasks_.pop_front();
    }
    task();
  }
}

}  // namespace heliograph::server
