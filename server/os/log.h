// Structured logging: an event and its fields, as text or JSON on stderr. Asset bytes, tokens and
// tickets are never fields.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <initializer_list>
#include <string>
#include <string_view>

#include "server/os/log_writer.h"

namespace heliograph::server {

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
  enum class Level : int { kDebug, kInfo, kWarning, kError, kOff };
  struct Limits {
    u64 bytes = 1 << 20;        // of lines that wait to be written
    u64 value_bytes = 1 << 10;  // of one value
  };
  /// level: "debug", "info", "warning", "error" or "off".
  Log(std::string_view level, bool json, Limits limits, int fd = STDERR_FILENO);

  void debug(std::string_view event, LogFields fields = {}) const;
  void info(std::string_view event, LogFields fields = {}) const;
  void warning(std::string_view event, LogFields fields = {}) const;
  void error(std::string_view event, LogFields fields = {}) const;

  [[nodiscard]] const LogWriter& writer() const { return writer_; }

 private:
  void write(Level level, std::string_view event, LogFields fields) const;
  [[nodiscard]] std::string line(Level level, std::string_view event, LogFields fields) const;

  const Level level_;
  const bool json_;
  const Limits limits_;
  mutable LogWriter writer_;
};

}  // namespace heliograph::server
