// The second socket of a local client: its session lives as long as this connection.
//
// On connect the daemon sends 16 random bytes, good once; OpenSession with them binds the session.
// After that both sides talk about shared buffers, a BufferWord a packet.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>

#include "renderer/frame/shared_memory.h"
#include "server/os/accept.h"

namespace heliograph::server {

/// What is said about a buffer, in the machine's byte order. Behind a new one of a device's memory
/// stands the device's UUID, 16 bytes.
struct BufferWord {
  // 0: the client wants frames in shared buffers, and the daemon agrees; with a descriptor, quick
  // calls over that socket
  u64 buffer = 0;
  // With a descriptor: bytes of a new buffer. Without one, from the daemon, 0: forget it; from the
  // client: the generation that it is done with, kUnmapped: it has forgotten the buffer, 0:
  // `buffer` is a generation, and it can never tell when that is over.
  u64 number = 0;

  static constexpr u64 kUnmapped = ~u64(0);
};

/// Owns: the listener and its connections. One that no session has is closed after a while.
/// Thread: the loop's, but for bind(), tell(), hear() and
/// release(), which any thread may call.
class Lifelines {
 public:
  /// Called for sessions that are bound.
  struct Handlers {
    std::function<void(u64 session)> lost;  // its connection ended; in the loop's thread
    std::function<void(u64 session, const BufferWord& word, ForeignFd fd)> said;
  };
  struct Limits {
    u32 total = 256;
    u32 per_peer = 64;  // of a process; those that the kernel does not name have no limit
    std::chrono::seconds unbound{30};
  };
  [[nodiscard]] static Expected<std::unique_ptr<Lifelines>> start(EventLoop& loop, const Log& log,
                                                                  ListeningSocket listener,
                                                                  Limits limits, Handlers handlers);
  ~Lifelines();

  /// UNAUTHENTICATED when the ticket was never given out, was used, or its connection ended.
  [[nodiscard]] Status bind(const std::string& ticket, u64 session);
  /// Sends a session a word, with the memory that it is about unless that is null; false when its
  /// socket takes nothing.
  [[nodiscard]] bool tell(u64 session, const BufferWord& word, const SharedMemory* memory);
  /// Reads what a session's client has said until now.
  void hear(u64 session);
  /// The session was closed: its connection is closed too.
  void release(u64 session);
  void stop_listening() { listener_.reset(); }

 private:
  struct Line {
    ForeignFd fd;
    pid_t process = 0;
    u64 number = 0;  // never used again, as a descriptor's is
    std::string ticket;
    u64 session = 0;  // 0: not bound
  };
  using Lines = std::unordered_map<int, Line>;

  Lifelines(EventLoop& loop, Limits limits, Handlers handlers);
  [[nodiscard]] Lines::iterator find(u64 session);   // under mutex_
  [[nodiscard]] bool has_room(pid_t process) const;  // the same
  void take(ForeignFd connection, const Peer& peer);
  void end_unbound(int fd, u64 number);
  void on_event(int fd, u32 events);
  /// A packet of a connection, if one waits there.
  struct Heard {
    u64 session = 0;
    BufferWord word;
    ForeignFd fd;
    bool is_word = false;
  };
  [[nodiscard]] std::optional<Heard> receive(int fd);
  [[nodiscard]] bool is_full(int fd);  // of its sender's descriptors as many wait as may
  void listen_to(int fd);
  void pause(int fd);
  [[nodiscard]] Status watch(int fd);

  EventLoop& loop_;
  const Limits limits_;
  const Handlers handlers_;
  std::unique_ptr<Listener> listener_;
  std::mutex hearing_;  // held until what was received was said; before mutex_
  std::mutex mutex_;
  Lines lines_;
  u64 last_number_ = 0;
  std::shared_ptr<int> alive_ = std::make_shared<int>(0);  // timers check it
};

}  // namespace heliograph::server
