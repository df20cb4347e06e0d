// The daemon's main thread: waits for sockets, timers and posted work. Nothing in it blocks.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "renderer/base/error.h"
#include "server/os/closer.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// Owns: an epoll set; not the watched descriptors. Thread: the one that calls run(); post() and
/// quit(): any.
class EventLoop {
 public:
  using Handler = std::function<void(u32 events)>;
  using Clock = std::chrono::steady_clock;

  /// close   closes descriptors of peers, in the closer's threads
  [[nodiscard]] static Expected<std::unique_ptr<EventLoop>> create(
      Closer::Close close = Closer::close_now);

  /// Calls `handler` with epoll's events (always EPOLLHUP and EPOLLERR too) until forget(fd).
  [[nodiscard]] Status watch(int fd, u32 events, Handler handler);
  void forget(int fd);
  void after(Clock::duration delay, std::function<void()> task);

  void post(std::function<void()> task);
  void quit();
  /// Handles events until quit().
  void run();
  /// Closes descriptors of peers. Thread: any.
  [[nodiscard]] Closer& closer() { return closer_; }

 private:
  EventLoop(UniqueFd epoll, UniqueFd wake, Closer::Close close);
  [[nodiscard]] int wait_ms() const;
  void run_timers();
  void run_posted();

  Closer closer_;  // first member: handlers own descriptors that it closes
  UniqueFd epoll_;
  UniqueFd wake_;  // an eventfd
  // Keyed by a number that is never reused, so that a late event cannot reach a reused descriptor.
  std::unordered_map<u64, std::shared_ptr<Handler>> handlers_;
  std::unordered_map<int, u64> numbers_;
  u64 last_number_ = 0;
  std::multimap<Clock::time_point, std::function<void()>> timers_;
  std::mutex mutex_;
  std::vector<std::function<void()>> posted_;
  bool quit_ = false;
};

}  // namespace heliograph::server
