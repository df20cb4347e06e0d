// Closes descriptors received from peers. close() of one may block as long as the peer likes: a
// socket with SO_LINGER, a file whose server does not answer, a socket whose queue holds such a
// descriptor.
#pragma once

#include <functional>
#include <memory>

#include "renderer/base/types.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// Owns: descriptors waiting to be closed, and threads that close them, created on demand. A sender
/// is any number that identifies the origin; one thread at a time closes a sender's descriptors, so
/// that a blocking one delays no other sender. The destructor waits for none of them. Thread: any.
class Closer {
 public:
  struct Limits {
    u32 lanes = 64;     // threads, and so senders whose descriptors may block at a time
    u32 waiting = 256;  // waiting descriptors per sender
    u32 open = 4096;    // waiting descriptors in total
  };
  using Close = std::function<void(UniqueFd)>;
  explicit Closer(Limits limits, Close close = close_now);
  ~Closer();
  Closer(const Closer&) = delete;
  Closer& operator=(const Closer&) = delete;

  /// Calls close(), with a socket's linger turned off.
  static void close_now(UniqueFd fd);

  /// Queues a descriptor. Never blocks.
  void close(UniqueFd fd, u64 sender = 0);
  /// Returns true when a sender's quota is used up: accept none of its descriptors.
  [[nodiscard]] bool is_full(u64 sender) const;
  /// Returns true when the total quota is used up.
  [[nodiscard]] bool is_full() const;
  /// Returns the number of descriptors not closed yet.
  [[nodiscard]] u32 open() const;

 private:
  struct State;
  static void work(const std::shared_ptr<State>& state);

  const std::shared_ptr<State> state_;
};

/// A descriptor that a peer opened or holds the other end of. The destructor passes it to a Closer.
class ForeignFd {
 public:
  /// Owns nothing.
  ForeignFd() = default;
  ForeignFd(Closer& closer, UniqueFd fd, u64 sender = 0)
      : closer_(&closer), sender_(sender), fd_(std::move(fd)) {}
  ForeignFd(ForeignFd&&) noexcept = default;
  ForeignFd& operator=(ForeignFd&& other) noexcept {
    if (fd_) closer_->close(std::move(fd_), sender_);
    closer_ = other.closer_;
    sender_ = other.sender_;
    fd_ = std::move(other.fd_);
    return *this;
  }
  ~ForeignFd() {
    if (fd_) closer_->close(std::move(fd_), sender_);
  }

  [[nodiscard]] int get() const { return fd_.get(); }
  [[nodiscard]] u64 sender() const { return sender_; }
  [[nodiscard]] UniqueFd release() { return std::move(fd_); }
  explicit operator bool() const { return bool(fd_); }

 private:
  Closer* closer_ = nullptr;
  u64 sender_ = 0;
  UniqueFd fd_;
};

}  // namespace heliograph::server
