// A bounded thread pool and its strands. Called by the RPC handlers.
#include "server/os/work_pool.h"

#include <fmt/format.h>

namespace heliograph::server {
namespace {

constexpr int kTasksATurn = 16;  // of a strand before it requeues itself

}  // namespace

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

Status WorkPool::post(u64 tenant, Task task) {
  {
    const std::lock_guard lock(mutex_);
    const auto found = tasks_.find(tenant);
    const std::size_t own = found == tasks_.end() ? 0 : found->second.size();
    if (own + waiting_ >= capacity_)
      return busy(fmt::format("{} requests wait already, {} of this tenant; retry later (limit "
                              "pool_queue)",
                              waiting_, own),
                  "pool_queue");
    push(tenant, std::move(task));
  }
  ready_.notify_one();
  return {};
}

void WorkPool::post_anyway(u64 tenant, Task task) {
  {
    const std::lock_guard lock(mutex_);
    push(tenant, std::move(task));
  }
  ready_.notify_one();
}

void WorkPool::push(u64 tenant, Task task) {
  if (waiting_ == 0) moved_ = std::chrono::steady_clock::now();
  std::deque<Task>& own = tasks_[tenant];
  if (own.empty()) turns_.push_back(tenant);
  own.push_back(std::move(task));
  ++waiting_;
}

/// Takes the oldest task of the tenant whose turn it is.
WorkPool::Task WorkPool::next() {
  const auto own = tasks_.find(turns_.front());
  turns_.pop_front();
  Task task = std::move(own->second.front());
  own->second.pop_front();
  if (own->second.empty())
    tasks_.erase(own);
  else
    turns_.push_back(own->first);
  --waiting_;
  return task;
}

double WorkPool::still_seconds() const {
  const std::lock_guard lock(mutex_);
  if (waiting_ == 0) return 0;
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - moved_).count();
}

void WorkPool::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    ready_.wait(lock, [this] { return stopping_ || waiting_ > 0; });
    if (waiting_ == 0) return;
    Task task = next();
    moved_ = std::chrono::steady_clock::now();
    lock.unlock();
    task();
    task = nullptr;  // frees its captures outside the lock
    lock.lock();
  }
}

Status Strand::run(WorkPool::Task task, bool is_short) {
  WorkPool::Task now;  // empty: the task was queued
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
  if (more) post_drain();
  return {};
}

void Strand::post_drain() {
  pool_.post_anyway(tenant_, [self = shared_from_this()] { self->drain(); });
}

void Strand::drain() {
  for (int i = 0; i < kTasksATurn; ++i) {
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
  post_drain();
}

}  // namespace heliograph::server
