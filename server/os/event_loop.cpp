// The epoll loop behind accept, the local channel, signals and grace timers.
#include "server/os/event_loop.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace heliograph::server {

Expected<std::unique_ptr<EventLoop>> EventLoop::create(Closer::Close close) {
  UniqueFd epoll(::epoll_create1(EPOLL_CLOEXEC));
  UniqueFd wake(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (!epoll || !wake) return fail(Code::kInternal, "", std::strerror(errno));
  const int wake_fd = wake.get();
  std::unique_ptr<EventLoop> loop(
      new EventLoop(std::move(epoll), std::move(wake), std::move(close)));
  HELIO_TRY(loop->watch(wake_fd, EPOLLIN, [self = loop.get()](u32) { self->run_posted(); }));
  return loop;
}

EventLoop::EventLoop(UniqueFd epoll, UniqueFd wake, Closer::Close close)
    : closer_(Closer::Limits(), std::move(close)),
      epoll_(std::move(epoll)),
      wake_(std::move(wake)) {}

Status EventLoop::watch(int fd, u32 events, Handler handler) {
  epoll_event event{.events = events, .data = {.u64 = ++last_number_}};
  if (::epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, fd, &event) != 0)
    return fail(Code::kResourceExhausted, "", std::strerror(errno));
  numbers_[fd] = last_number_;
  handlers_[last_number_] = std::make_shared<Handler>(std::move(handler));
  return {};
}

void EventLoop::forget(int fd) {
  const auto found = numbers_.find(fd);
  if (found == numbers_.end()) return;
  handlers_.erase(found->second);
  numbers_.erase(found);
  ::epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, fd, nullptr);
}

void EventLoop::after(Clock::duration delay, std::function<void()> task) {
  timers_.emplace(Clock::now() + delay, std::move(task));
}

void EventLoop::post(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    posted_.push_back(std::move(task));
  }
  const u64 one = 1;
  [[maybe_unused]] const auto written = ::write(wake_.get(), &one, sizeof one);
}

void EventLoop::quit() {
  post([this] { quit_ = true; });
}

void EventLoop::run() {
  std::array<epoll_event, 64> events;
  while (!quit_) {
    const int count = ::epoll_wait(epoll_.get(), events.data(), int(events.size()), wait_ms());
    for (int i = 0; i < count; ++i) {
      const auto found = handlers_.find(events[std::size_t(i)].data.u64);
      if (found == handlers_.end()) continue;  // forgotten by a handler of this round
      const auto handler = found->second;      // it may forget itself
      (*handler)(events[std::size_t(i)].events);
    }
    run_timers();
  }
}

int EventLoop::wait_ms() const {
  if (timers_.empty()) return -1;
  const auto wait =
      std::chrono::ceil<std::chrono::milliseconds>(timers_.begin()->first - Clock::now());
  return int(std::clamp<i64>(wait.count(), 0, 60'000));
}

void EventLoop::run_timers() {
  while (!timers_.empty() && timers_.begin()->first <= Clock::now()) {
    const auto task = std::move(timers_.begin()->second);
    timers_.erase(timers_.begin());
    task();
  }
}

void EventLoop::run_posted() {
  u64 count;
  [[maybe_unused]] const auto read = ::read(wake_.get(), &count, sizeof count);
  std::vector<std::function<void()>> tasks;
  {
    const std::lock_guard lock(mutex_);
    tasks.swap(posted_);
  }
  for (const auto& task : tasks) task();
}

}  // namespace heliograph::server
