// The second socket of a local client: its session lives as long as this connection.
//
// On connect the daemon sends 16 random bytes, good once; OpenSession with them binds the session.
// After that both sides talk about shared buffers, a BufferWord a packet.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>

#include "server/accept.h"

namespace heliograph::server {

/// What is said about a buffer, in the machine's byte order.
struct BufferWord {
  u64 buffer = 0;  // 0: the client wants frames in shared buffers; the daemon agrees
  // From the daemon: bytes of the buffer, whose descriptor comes with it; 0: forget it.
  // From the client: the generation that it is done with; 0: it can never tell.
  u64 number = 0;
};

/// Owns: the listener and its connections. Thread: the loop's, but for bind(), tell() and
/// release(), which any thread may call.
class Lifelines {
 public:
  /// Called in the loop's thread, for sessions that are bound.
  struct Handlers {
    std::function<void(u64 session)> lost;  // its connection ended
    std::function<void(u64 session, const BufferWord& word)> said;
  };
  [[nodiscard]] static Expected<std::unique_ptr<Lifelines>> start(EventLoop& loop, const Log& log,
                                                                  UniqueFd listener, u32 limit,
                                                                  Handlers handlers);
  ~Lifelines();

  /// UNAUTHENTICATED when the ticket was never given out, was used, or its connection ended.
  [[nodiscard]] Status bind(const std::string& ticket, u64 session);
  /// Sends a session a word, with a descriptor unless that is -1; false when its socket takes
  /// nothing.
  [[nodiscard]] bool tell(u64 session, const BufferWord& word, int fd);
  /// The session was closed: its connection is closed too.
  void release(u64 session);
  void stop_listening() { listener_.reset(); }

 private:
  struct Line {
    UniqueFd fd;
    std::string ticket;
    u64 session = 0;  // 0: not bound
  };

  Lifelines(EventLoop& loop, u32 limit, Handlers handlers);
  void take(UniqueFd connection);
  void on_event(int fd, u32 events);
  void listen_to(int fd);

  EventLoop& loop_;
  const u32 limit_;
  const Handlers handlers_;
  std::unique_ptr<Listener> listener_;
  std::mutex mutex_;
  std::unordered_map<int, Line> lines_;
};

}  // namespace heliograph::server
