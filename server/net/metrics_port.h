// The port that Prometheus reads: HTTP, GET /metrics and nothing else. Called by lifecycle.cpp.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <unordered_map>

#include "server/os/accept.h"

namespace heliograph::server {

/// Binds a numeric address "ADDRESS:PORT" or "[ADDRESS]:PORT"; port 0 takes a free one.
[[nodiscard]] Expected<ListeningSocket> listen_for_metrics(const std::string& address);
/// Whether only this machine can reach it.
[[nodiscard]] bool is_loopback(int fd);

/// Answers one request a connection, on the event loop: no thread, at most some connections at a
/// time and of one address, each for some seconds and with a short request. One too many takes the
/// place of the oldest that asked nothing. Owns: its sockets. Thread: the loop's.
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

  /// `page` is called for each scrape.
  [[nodiscard]] static Expected<std::unique_ptr<MetricsPort>> start(Options options, Page page);
  ~MetricsPort();

 private:
  struct Connection {
    ForeignFd fd;
    std::string peer;
    u64 number;
    std::string request;
    std::string reply;  // what is left of it
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
