// Structured logging: an event and its fields, through spdlog, as text or JSON on stderr. Asset
// bytes, tokens and tickets are never fields.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <initializer_list>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "renderer/base/types.h"

namespace spdlog {
class logger;  // NOLINT(readability-identifier-naming): theirs
}

namespace heliograph::server {

class LogWriter;

struct LogField {
  std::string_view name;
  std::string value;

  LogField(std::string_view n, std::string_view v) : name(n), value(v) {}
  template <class T>
    requires std::is_arithmetic_v<T>
  LogField(std::string_view n, T v) : name(n), value(fmt::format("{}", v)) {}
};
using LogFields = std::initializer_list<LogField>;

/// Quotes a value, cut to `bytes` bytes with a note of how many more there were. Control,
/// bidirectional and invisible characters become \uXXXX, invalid UTF-8 \\xXX. The result is a JSON
/// string.
[[nodiscard]] std::string quoted(std::string_view value, u64 bytes);

/// Structured log. Thread: any. A slow reader of stderr never blocks a caller.
class Log {
 public:
  enum class Level : int { kDebug = 1, kInfo, kWarning, kError };  // spdlog's numbers
  struct Limits {
    u64 bytes = 1 << 20;        // of queued lines
    u64 value_bytes = 1 << 10;  // per value
  };
  /// level: "debug", "info", "warning", "error" or "off".
  Log(const std::string& level, bool json, Limits limits, int fd = STDERR_FILENO);
  /// Calls flush().
  ~Log();
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

  void debug(std::string_view event, LogFields fields = {}) const;
  void info(std::string_view event, LogFields fields = {}) const;
  void warning(std::string_view event, LogFields fields = {}) const;
  void error(std::string_view event, LogFields fields = {}) const;
  /// The same, with a computed level and fields.
  void write(Level level, std::string_view event, std::span<const LogField> fields) const;
  [[nodiscard]] bool is_on(Level level) const;

  /// Waits until the queue is written, for 1 s at most.
  void flush() const;
  /// Returns the number of lines dropped since the start because stderr was not read in time.
  [[nodiscard]] u64 dropped() const;
  /// Returns how long the current write has taken, in seconds; 0: none.
  [[nodiscard]] double still_seconds() const;

 private:
  const bool json_;
  const u64 value_bytes_;
  const std::shared_ptr<LogWriter> writer_;
  const std::unique_ptr<spdlog::logger> logger_;
};

}  // namespace heliograph::server
