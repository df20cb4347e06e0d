// Edits on their way: numbered, pipelined, sent again after a lost connection. Called by
// Transaction.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "wire/session.h"

namespace heliograph::client::wire {

struct PendingEdit;

/// ApplyStream that carries the edits of some scenes in one order. It has no thread: a caller that
/// waits for its reply reads for all. After a lost connection everything without a reply is sent
/// again under its number, which the daemon answers from memory if it was applied.
class ApplyLane {
 public:
  explicit ApplyLane(Session& session);
  ~ApplyLane();
  ApplyLane(const ApplyLane&) = delete;
  ApplyLane& operator=(const ApplyLane&) = delete;

  /// The number that the next edit of a scene carries; without it the daemon is asked.
  void expect(std::uint64_t scene, std::uint64_t next);
  void forget(std::uint64_t scene);

  /// Numbers and sends it; waits while too many are on their way.
  void submit(const std::shared_ptr<PendingEdit>& edit);
  /// Waits until an edit has its reply or its error.
  void wait(const PendingEdit& edit);
  /// Waits some seconds for edits under way, then ends the stream.
  void close();

 private:
  using Lock = std::unique_lock<std::mutex>;
  using Time = std::chrono::system_clock::time_point;
  struct Stream;

  bool is_waiting(std::uint64_t scene) const;
  std::uint64_t number_of(std::uint64_t scene);
  void open();
  void pump();
  void step(Lock& lock, std::optional<Time> until = {});
  void handle(void* tag, bool ok);
  void take_reply();
  void end_stream(Lock& lock);
  void fail_all(const ClientError& error);

  Session& session_;
  std::mutex mutex_;  // of all that follows
  std::condition_variable changed_;
  std::map<std::uint64_t, std::uint64_t> next_;       // scene to number
  std::deque<std::shared_ptr<PendingEdit>> waiting_;  // without a reply, in order
  std::size_t sent_ = 0;                              // so many of them, on this stream
  std::unique_ptr<Stream> stream_;
  bool is_polled_ = false;  // by the thread that is in the completion queue
  std::optional<Patience> patience_;
};

}  // namespace heliograph::client::wire
