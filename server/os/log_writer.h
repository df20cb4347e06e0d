// The sink of the log: a thread that writes what spdlog made of each line. stderr may be a pipe
// that nobody reads: whoever logs never waits for it. docs/decisions/045 says why not spdlog's own.
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

/// Owns: lines that wait. Its thread has it too, as it may be left behind in a write that never
/// ends. Thread: any.
class LogWriter final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  /// What the line says that tells how many lines were dropped before it.
  using DroppedLine = std::function<std::string(u64 lines)>;

  /// fd     stays the caller's, and open until the process ends
  /// bytes  of lines that wait; what comes beyond is dropped and counted
  [[nodiscard]] static std::shared_ptr<LogWriter> start(int fd, u64 bytes, DroppedLine dropped);

  /// Ends the thread, after flush().
  void close();
  /// Of a line that could not be made.
  void lose();
  /// Lines since the start.
  [[nodiscard]] u64 dropped();
  /// How long the present write has taken; 0 without one.
  [[nodiscard]] double still_seconds();

 private:
  using Clock = std::chrono::steady_clock;

  LogWriter(int fd, u64 bytes, DroppedLine dropped)
      : fd_(fd), room_(bytes), dropped_line_(std::move(dropped)) {}
  void work();

  // Under mutex_, which is spdlog's, as is all that follows.
  /// Takes a line. Returns at once.
  void sink_it_(const spdlog::details::log_msg& message) override;
  /// Waits until all is written, for a second at most.
  void flush_() override;
  [[nodiscard]] std::string format(const spdlog::details::log_msg& message) const;
  [[nodiscard]] std::string next();

  const int fd_;
  const u64 room_;
  const DroppedLine dropped_line_;
  std::condition_variable changed_;
  std::deque<std::string> lines_;  // the first one may be on its way
  u64 bytes_ = 0;                  // of these
  u64 dropped_ = 0;
  u64 told_ = 0;  // of the dropped ones
  Clock::time_point began_;
  bool is_writing_ = false;
  bool is_over_ = false;
};

}  // namespace heliograph::server
