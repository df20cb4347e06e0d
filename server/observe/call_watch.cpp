// One timer for all calls. See call_watch.h.
#include "server/observe/call_watch.h"

namespace heliograph::server {
namespace {

constexpr auto kEvery = std::chrono::milliseconds(500);

}  // namespace

void CallWatch::start(EventLoop& loop) {
  loop_ = &loop;
  loop_->after(kEvery, [this] { look(); });
}

void CallWatch::add(std::weak_ptr<Watched> call) {
  const std::lock_guard lock(mutex_);
  calls_.push_back(std::move(call));
}

void CallWatch::look() {
  std::vector<std::shared_ptr<Watched>> alive;
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(calls_, [](const auto& call) { return call.expired(); });
    for (const auto& call : calls_)
      if (auto found = call.lock()) alive.push_back(std::move(found));
  }
  const auto now = EventLoop::Clock::now();
  for (const auto& call : alive) call->look_at(now);
  loop_->after(kEvery, [this] { look(); });
}

}  // namespace heliograph::server
