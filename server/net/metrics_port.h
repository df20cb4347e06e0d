// The metrics port, for Prometheus: HTTP, GET /metrics and nothing else. Called by lifecycle.cpp.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <unordered_map>

#include "server/os/accept.h"

namespace heliograph::server {

/// Binds a numeric address "ADDRESS:PORT" or "[ADDRESS]:PORT"; port 0 takes a free one.
[[nodiscard]] Expected<ListeningSocket> listen_for_metrics(const std::string& address);
/// Returns true when a listener is reachable from this machine alone.
[[nodiscard]] bool is_loopback(int fd);

/// Answers one request per connection, on the event loop. The number of connections, in total and
/// per address, their duration and the request's length are limited. A connection beyond the limit
/// replaces the oldest one that has sent no request. Owns: its sockets. Thread: the loop's.
class MetricsPort {
 public:
  using Page = std::function<std::string()>;
  struct Limits {
    u32 total = 32;
    u32 per_peer = 8;
  };
  struct Options {
    EventLoop& loop;
    const Log& log;
    ListeningSocket socket;
    Limits limits;
  };

  /// page   makes the reply; called for each scrape
  [[nodiscard]] static Expected<std::unique_ptr<MetricsPort>> start(Options options, Page page);
  ~MetricsPort();

 private:
  struct Connection {
    ForeignFd fd;
    std::string peer;
    u64 number;
    std::string request;
    std::string reply;  // rest of the reply to write
  };
  MetricsPort(EventLoop& loop, Limits limits, Page page)
      : loop_(loop), limits_(limits), page_(std::move(page)) {}
  void take(ForeignFd fd, const std::string& peer);
  [[nodiscard]] bool make_room(const std::string& peer);
  void on_event(int fd);
  void read(Connection& connection);
  void write(Connection& connection);
  void close(int fd);

  EventLoop& loop_;
  const Limits limits_;
  const Page page_;
  std::unique_ptr<Listener> listener_;
  std::unordered_map<int, Connection> open_;
  u64 last_number_ = 0;
  std::shared_ptr<int> alive_ = std::make_shared<int>(0);  // timers check it
};

}  // namespace heliograph::server
