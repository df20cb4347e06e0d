// One timer for all calls. See stall_monitor.h.
#include "server/observe/stall_monitor.h"

namespace heliograph::server {
namespace {

constexpr auto kEvery = std::chrono::milliseconds(500);

}  // namespace

void StallMonitor::start(EventLoop& loop) {
  loop_ = &loop;
  loop_->after(kEvery, [this] { tick(); });
}

void StallMonitor::add(std::weak_ptr<Monitored> call) {
  const std::lock_guard lock(mutex_);
  calls_.push_back(std::move(call));
}

void StallMonitor::tick() {
  std::vector<std::shared_ptr<Monitored>> alive;
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(calls_, [](const auto& call) { return call.expired(); });
    for (const auto& call : calls_)
      if (auto found = call.lock()) alive.push_back(std::move(found));
  }
  const auto now = EventLoop::Clock::now();
  for (const auto& call : alive) call->run_tick(now);
  loop_->after(kEvery, [this] { tick(); });
}

}  // namespace heliograph::server
