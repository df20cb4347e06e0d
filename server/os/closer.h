// Closing descriptors that others opened. close() of such a one takes as long as they like: a
// socket with SO_LINGER, a file whose server does not answer, a socket in whose queue such a one
// waits.
#pragma once

#include <memory>

#include "renderer/base/types.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// Owns: descriptors that wait, and up to `lanes` threads that close them, begun when they are
/// needed. Its end waits for none of them. Thread: any.
class Closer {
 public:
  struct Limits {
    u32 lanes = 8;
    u32 waiting = 256;
  };
  explicit Closer(Limits limits);
  ~Closer();
  Closer(const Closer&) = delete;
  Closer& operator=(const Closer&) = delete;

  /// Returns at once.
  void close(UniqueFd fd);
  /// As many wait as may: whoever can do without takes no more descriptors of others.
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
  ForeignFd(Closer& closer, UniqueFd fd) : closer_(&closer), fd_(std::move(fd)) {}
  ForeignFd(ForeignFd&&) noexcept = default;
  ForeignFd& operator=(ForeignFd&& other) noexcept {
    if (fd_) closer_->close(std::move(fd_));
    closer_ = other.closer_;
    fd_ = std::move(other.fd_);
    return *this;
  }
  ~ForeignFd() {
    if (fd_) closer_->close(std::move(fd_));
  }

  [[nodiscard]] int get() const { return fd_.get(); }
  [[nodiscard]] UniqueFd release() { return std::move(fd_); }
  explicit operator bool() const { return bool(fd_); }

 private:
  Closer* closer_ = nullptr;
  UniqueFd fd_;
};

}  // namespace heliograph::server
