// The thread that writes the log. stderr may be a pipe that nobody reads: whoever logs never waits
// for it.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "renderer/base/types.h"

namespace heliograph::server {

/// Owns: lines that wait, and the thread that writes them. Thread: any.
class LogWriter {
 public:
  /// The line that says how many lines were dropped before it.
  using DroppedLine = std::function<std::string(u64 lines)>;

  /// fd     stays the caller's, and open until the process ends
  /// bytes  of lines that wait; what comes beyond is dropped and counted
  LogWriter(int fd, u64 bytes, DroppedLine dropped);
  /// After flush().
  ~LogWriter();
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;

  /// A line with its newline. Returns at once.
  void write(std::string line);
  /// Waits until all is written, for a second at most.
  void flush() const;
  /// Lines since the start.
  [[nodiscard]] u64 dropped() const;
  /// How long the present write has taken; 0 without one.
  [[nodiscard]] double still_seconds() const;

 private:
  struct State;
  static void work(const std::shared_ptr<State>& state);

  const std::shared_ptr<State> state_;
};

}  // namespace heliograph::server
