// Structured logging: an event and its fields, as text or JSON on stderr. Asset bytes, tokens and
// tickets are never fields.
#pragma once

#include <fmt/format.h>
#include <spdlog/fwd.h>

#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>

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

/// Thread: any.
class Log {
 public:
  /// level: "debug", "info", "warning", "error" or "off".
  Log(const std::string& level, bool json);
  ~Log();

  void debug(std::string_view event, LogFields fields = {}) const;
  void info(std::string_view event, LogFields fields = {}) const;
  void warning(std::string_view event, LogFields fields = {}) const;
  void error(std::string_view event, LogFields fields = {}) const;

 private:
  void write(int level, std::string_view event, LogFields fields) const;
  std::shared_ptr<spdlog::logger> logger_;
  bool json_;
};

}  // namespace heliograph::server
