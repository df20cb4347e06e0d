// Quick calls: Apply and Render of a local session over a SOCK_SEQPACKET socket of its own, one
// packet each way. They spare a short call gRPC's latency. See docs/protocol.md, "Quick calls".
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

/// Owns: one socket per session, each with a thread that reads it. Thread: any.
class QuickCalls {
 public:
  explicit QuickCalls(Daemon& daemon) : daemon_(daemon) {}
  ~QuickCalls() { stop(); }

  /// False while calls are recorded: the recorder sees gRPC only.
  [[nodiscard]] static bool are_possible(const Daemon& daemon);

  /// Answers the session's calls over `socket` until the client closes it or the session ends.
  /// Replaces and closes the session's earlier socket. Closes `socket` at once when it is no
  /// SOCK_SEQPACKET, or beyond the tenant's limit.
  void serve(const std::shared_ptr<Session>& session, ForeignFd socket);
  /// Closes all sockets, waits for their threads, and serves none from then on.
  void stop();

 private:
  class FastPathConnection;
  void forget(u64 session, std::shared_ptr<FastPathConnection> connection);

  Daemon& daemon_;
  std::mutex mutex_;
  std::condition_variable ended_;
  bool is_stopped_ = false;
  u32 threads_ = 0;
  std::unordered_map<u64, std::shared_ptr<FastPathConnection>> connections_;  // by session
};

}  // namespace heliograph::server
