// Closing descriptors that others opened. close() of such a one takes as long as they like: a
// socket with SO_LINGER, a file whose server does not answer, a socket in whose queue such a one
// waits.
#pragma once

#include <functional>
#include <memory>

#include "renderer/base/types.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// Owns: descriptors that wait, and threads that close them, begun when they are needed. Whoever a
/// descriptor came from is its sender, by any number: of one sender's a single thread closes one at
/// a time, so that nobody else waits for what hangs. Its end waits for none of them. Thread: any.
class Closer {
 public:
  struct Limits {
    u32 lanes = 64;     // threads: so many senders' descriptors may hang at a time
    u32 waiting = 256;  // descriptors of one sender
    u32 open = 4096;    // of all senders
  };
  using Close = std::function<void(UniqueFd)>;
  explicit Closer(Limits limits, Close close = close_now);
  ~Closer();
  Closer(const Closer&) = delete;
  Closer& operator=(const Closer&) = delete;

  /// The kernel's close(), without a socket's linger.
  static void close_now(UniqueFd fd);

  /// Returns at once.
  void close(UniqueFd fd, u64 sender = 0);
  /// As many of this sender's wait as may: no more of its descriptors are taken.
  [[nodiscard]] bool is_full(u64 sender) const;
  /// As many of all senders' are open as may.
  [[nodiscard]] bool is_full() const;
  /// Descriptors that are not closed yet.
  [[nodiscard]] u32 open() const;

 private:
  struct State;
  static void work(const std::shared_ptr<State>& state);

  const std::shared_ptr<State> state_;
};

/// A descriptor that somebody else opened or has the other end of; a Closer ends it.
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
