#include "server/decode/queue.h"

#include <fmt/format.h>

namespace heliograph::server {
namespace {

constexpr double kRetrySeconds = 1;

}  // namespace

Status DecodeQueue::push(DecodeTask& task) {
  {
    const std::lock_guard lock(mutex_);
    Lane& lane = lanes_[task.job.tenant];
    if (lane.waiting.size() >= limits_.waiting) {
      Error error{.code = Code::kResourceExhausted,
                  .message = fmt::format("{} decodes wait already: wait for some to end "
                                         "(limit decode_queue)",
                                         lane.waiting.size()),
                  .where = ""};
      error.limit = "decode_queue";
      error.needed = 1;
      error.allowed = limits_.waiting;
      error.retry_seconds = kRetrySeconds;
      return std::unexpected(std::move(error));
    }
    lane.waiting.push_back(std::move(task));
  }
  changed_.notify_one();
  return {};
}

std::optional<DecodeTask> DecodeQueue::take(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  auto found = lanes_.end();
  if (!changed_.wait(lock, stop, [&] { return (found = next()) != lanes_.end(); }) ||
      stop.stop_requested())
    return {};
  auto& [tenant, lane] = *found;
  last_ = tenant;
  ++lane.running;
  DecodeTask task = std::move(lane.waiting.front());
  lane.waiting.pop_front();
  return task;
}

void DecodeQueue::end(u64 tenant) {
  {
    const std::lock_guard lock(mutex_);
    const auto lane = lanes_.find(tenant);
    if (--lane->second.running == 0 && lane->second.waiting.empty()) lanes_.erase(lane);
  }
  changed_.notify_one();
}

std::vector<DecodeTask> DecodeQueue::rest() {
  const std::lock_guard lock(mutex_);
  std::vector<DecodeTask> tasks;
  for (auto& [tenant, lane] : lanes_) {
    std::ranges::move(lane.waiting, std::back_inserter(tasks));
    lane.waiting.clear();
  }
  return tasks;
}

/// Returns the next tenant in ring order that has work and is below its limit.
DecodeQueue::Lanes::iterator DecodeQueue::next() {
  auto lane = lanes_.upper_bound(last_);
  for (std::size_t i = 0; i < lanes_.size(); ++i, ++lane) {
    if (lane == lanes_.end()) lane = lanes_.begin();
    if (!lane->second.waiting.empty() && lane->second.running < limits_.running) return lane;
  }
  return lanes_.end();
}

}  // namespace heliograph::server
