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

/// A value between quotes, of at most `bytes` bytes and a mark that says how many more there were:
/// control, bidirectional and invisible characters as \uXXXX, bytes that are no UTF-8 as \\xXX. It
/// is a string of JSON too.
[[nodiscard]] std::string quoted(std::string_view value, u64 bytes);

/// Thread: any. Nobody waits for who reads it.
class Log {
 public:
  enum class Level : int { kDebug = 1, kInfo, kWarning, kError };  // spdlog's numbers
  struct Limits {
    u64 bytes = 1 << 20;        // of lines that wait to be written
    u64 value_bytes = 1 << 10;  // of one value
  };
  /// level: "debug", "info", "warning", "error" or "off".
  Log(const std::string& level, bool json, Limits limits, int fd = STDERR_FILENO);
  /// After flush().
  ~Log();
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

  void debug(std::string_view event, LogFields fields = {}) const;
  void info(std::string_view event, LogFields fields = {}) const;
  void warning(std::string_view event, LogFields fields = {}) const;
  void error(std::string_view event, LogFields fields = {}) const;
  /// The same, for who works out the level and the fields.
  void write(Level level, std::string_view event, std::span<const LogField> fields) const;
  [[nodiscard]] bool is_on(Level level) const;

  /// Waits until all is written, for a second at most.
  void flush() const;
  /// Lines since the start that nobody read in time.
  [[nodiscard]] u64 dropped() const;
  /// How long the present write has taken; 0 without one.
  [[nodiscard]] double still_seconds() const;

 private:
  const bool json_;
  const u64 value_bytes_;
  const std::shared_ptr<LogWriter> writer_;
  const std::unique_ptr<spdlog::logger> logger_;
};

}  // namespace heliograph::server
