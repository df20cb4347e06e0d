// Sink of the log: a thread writes the lines that spdlog formatted. stderr may be a pipe that
// nobody reads: logging never waits for it. docs/decisions/045 states why not spdlog's own.
#pragma once

#include <spdlog/sinks/base_sink.h>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "renderer/base/types.h"

namespace heliograph::server {

/// Owns: queued lines. Its thread shares ownership, since it may stay behind in a write that never
/// ends. Thread: any.
class LogWriter final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  /// Formats the notice that so many lines were dropped before it.
  using DroppedLine = std::function<std::string(u64 lines)>;

  /// fd     stays the caller's, and open until the process ends
  /// bytes  limit of queued lines; further lines are dropped and counted
  [[nodiscard]] static std::shared_ptr<LogWriter> start(int fd, u64 bytes, DroppedLine dropped);

  /// Ends the thread after flush().
  void close();
  /// Counts a line that could not be formatted as dropped.
  void lose();
  /// Returns the number of lines dropped since the start.
  [[nodiscard]] u64 dropped();
  /// Returns how long the current write has taken, in seconds; 0: none.
  [[nodiscard]] double still_seconds();

 private:
  using Clock = std::chrono::steady_clock;

  LogWriter(int fd, u64 bytes, DroppedLine dropped)
      : fd_(fd), room_(bytes), dropped_line_(std::move(dropped)) {}
  void work();

  // Under mutex_, spdlog's, as is all that follows.
  /// Queues a line. Never blocks.
  void sink_it_(const spdlog::details::log_msg& message) override;
  /// Waits until the queue is written, for 1 s at most.
  void flush_() override;
  [[nodiscard]] std::string format(const spdlog::details::log_msg& message) const;
  [[nodiscard]] std::string next();

  const int fd_;
  const u64 room_;
  const DroppedLine dropped_line_;
  std::condition_variable changed_;
  std::deque<std::string> lines_;  // the first may be in a write
  u64 bytes_ = 0;                  // of lines_
  u64 dropped_ = 0;
  u64 reported_ = 0;  // dropped lines that a notice reported
  Clock::time_point began_;
  bool is_writing_ = false;
  bool is_over_ = false;
};

}  // namespace heliograph::server
