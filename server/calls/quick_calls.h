// Apply and Render of local clients over a socket of their own, a packet each way: gRPC and its
// threads are most of what a short call takes. See docs/protocol.md, "Quick calls".
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <unordered_map>

#include "server/os/closer.h"
#include "server/os/unique_fd.h"
#include "server/session/session.h"

namespace heliograph::server {

struct Daemon;

/// Owns: the sockets, each with a thread that reads it. Thread: any.
class QuickCalls {
 public:
  explicit QuickCalls(Daemon& daemon) : daemon_(daemon) {}
  ~QuickCalls() { stop(); }

  /// Not while calls are recorded: a recording has what comes by gRPC.
  [[nodiscard]] static bool are_possible(const Daemon& daemon);

  /// Answers the session's calls over this socket until the client closes it or the session ends.
  /// The one that it had before is closed; so is one that is no SOCK_SEQPACKET, or one too many.
  void serve(const std::shared_ptr<Session>& session, ForeignFd socket);
  /// Closes all of them and waits for their threads. No other begins.
  void stop();

 private:
  class Line;
  void forget(u64 session, std::shared_ptr<Line> line);

  Daemon& daemon_;
  std::mutex mutex_;
  std::condition_variable ended_;
  bool is_stopped_ = false;
  u32 threads_ = 0;
  std::unordered_map<u64, std::shared_ptr<Line>> lines_;  // by session
};

}  // namespace heliograph::server
