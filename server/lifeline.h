// The second socket of a local client: its session lives as long as this connection.
//
// On connect the daemon sends 16 random bytes, good once; OpenSession with them binds the session.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>

#include "server/accept.h"

namespace heliograph::server {

/// Owns: the listener and its connections. Thread: the loop's, but for bind() and release(), which
/// any thread may call.
class Lifelines {
 public:
  /// `lost` is called in the loop's thread when the connection of a bound session ends.
  [[nodiscard]] static Expected<std::unique_ptr<Lifelines>> start(
      EventLoop& loop, const Log& log, UniqueFd listener, u32 limit,
      std::function<void(u64 session)> lost);
  ~Lifelines();

  /// UNAUTHENTICATED when the ticket was never given out, was used, or its connection ended.
  [[nodiscard]] Status bind(const std::string& ticket, u64 session);
  /// The session was closed: its connection is closed too.
  void release(u64 session);
  void stop_listening() { listener_.reset(); }

 private:
  struct Line {
    UniqueFd fd;
    std::string ticket;
    u64 session = 0;  // 0: not bound
  };

  Lifelines(EventLoop& loop, u32 limit, std::function<void(u64)> lost);
  void take(UniqueFd connection);
  void on_event(int fd, u32 events);

  EventLoop& loop_;
  const u32 limit_;
  std::function<void(u64)> lost_;
  std::unique_ptr<Listener> listener_;
  std::mutex mutex_;
  std::unordered_map<int, Line> lines_;
};

}  // namespace heliograph::server
