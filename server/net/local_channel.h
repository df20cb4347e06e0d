// The local channel: a SOCK_SEQPACKET connection beside gRPC for each session of a local client,
// which keeps that session open.
//
// On connect the daemon sends 16 random bytes, a ticket that is valid once; OpenSession with it
// binds the connection to the session. From then on each packet is one BufferMessage.
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

/// A packet about a shared buffer, in the machine's byte order. For a new buffer in a device's
/// memory the device's UUID, 16 bytes, follows it.
struct BufferMessage {
  // Number of the buffer. 0: the client asks for frames in shared buffers, and the daemon agrees;
  // with a descriptor: a socket for quick calls.
  u64 buffer = 0;
  // With a descriptor: size of the new buffer in bytes. Without one, from the daemon, 0: forget the
  // buffer. From the client: the generation that it returns; kUnmapped: it has unmapped the buffer;
  // 0: `buffer` is a generation that will never be returned.
  u64 number = 0;

  static constexpr u64 kUnmapped = ~u64(0);
};

/// Owns: the listener and its connections. A connection without a session is closed after
/// Limits::unbound. Thread: the loop's; bind(), send(), poll() and release(): any.
class LocalChannel {
 public:
  /// Called for bound sessions only.
  struct Handlers {
    std::function<void(u64 session)> on_closed;  // its connection ended; thread: the loop's
    /// Thread: the loop's, or poll()'s caller; one call at a time.
    std::function<void(u64 session, const BufferMessage& message, ForeignFd fd)> on_message;
  };
  struct Limits {
    u32 total = 256;
    u32 per_peer = 64;  // per process; no limit where the kernel does not name it
    std::chrono::seconds unbound{30};
  };
  [[nodiscard]] static Expected<std::unique_ptr<LocalChannel>> start(
      EventLoop& loop, const Log& log, ListeningSocket listener, Limits limits, Handlers handlers);
  ~LocalChannel();

  /// UNAUTHENTICATED when the ticket was never given out, was used, or its connection ended.
  [[nodiscard]] Status bind(const std::string& ticket, u64 session);
  /// Sends a message to the session's client, with a descriptor of `memory` unless that is null.
  /// False when the socket accepts nothing.
  [[nodiscard]] bool send(u64 session, const BufferMessage& message, const SharedMemory* memory);
  /// Delivers the messages that the session's client has sent so far.
  void poll(u64 session);
  /// Closes the connection of a session that was closed.
  void release(u64 session);
  void stop_listening() { listener_.reset(); }

 private:
  struct LocalConnection {
    ForeignFd fd;
    pid_t process = 0;
    u64 number = 0;  // unique; the number of a descriptor is reused
    std::string ticket;
    u64 session = 0;  // 0: not bound
  };
  using Connections = std::unordered_map<int, LocalConnection>;

  LocalChannel(EventLoop& loop, Limits limits, Handlers handlers);
  [[nodiscard]] Connections::iterator find(u64 session);  // under mutex_
  [[nodiscard]] bool has_room(pid_t process) const;       // under mutex_
  void accept(ForeignFd connection, const Peer& peer);
  void end_unbound(int fd, u64 number);
  void on_event(int fd, u32 events);
  struct Packet {
    u64 session = 0;
    BufferMessage message;
    ForeignFd fd;
    bool is_whole = false;  // of a BufferMessage's size
  };
  /// The next packet of a connection; none when none waits.
  [[nodiscard]] std::optional<Packet> receive(int fd);
  /// True when the sender has as many descriptors waiting to be closed as it may have.
  [[nodiscard]] bool is_full(int fd);
  void receive_from(int fd);
  void pause(int fd);
  [[nodiscard]] Status watch(int fd);

  EventLoop& loop_;
  const Limits limits_;
  const Handlers handlers_;
  std::unique_ptr<Listener> listener_;
  std::mutex delivery_mutex_;  // held from receive() to on_message(); locked before mutex_
  std::mutex mutex_;
  Connections connections_;
  u64 last_number_ = 0;
  std::shared_ptr<int> alive_ = std::make_shared<int>(0);  // timers check it
};

}  // namespace heliograph::server
