// Log lines through spdlog. Called from everywhere in server/.
#include "server/os/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

namespace heliograph::server {
namespace {

void append_escaped(std::string& out, std::string_view text) {
  out += '"';
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      out += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    } else {
      out += c;
    }
  }
  out += '"';
}

std::string json_line(std::string_view event, LogFields fields) {
  std::string line = "\"event\":";
  append_escaped(line, event);
  for (const LogField& field : fields) {
    line += ',';
    append_escaped(line, field.name);
    line += ':';
    append_escaped(line, field.value);
  }
  return line;
}

std::string text_line(std::string_view event, LogFields fields) {
  std::string line(event);
  for (const LogField& field : fields) {
    line += fmt::format(" {}=", field.name);
    append_escaped(line, field.value);
  }
  return line;
}

}  // namespace

Log::Log(const std::string& level, bool json) : json_(json) {
  logger_ = std::make_shared<spdlog::logger>("heliographd",
                                             std::make_shared<spdlog::sinks::stderr_sink_mt>());
  logger_->set_level(spdlog::level::from_str(level));
  logger_->set_pattern(json ? R"({"time":"%Y-%m-%dT%H:%M:%S.%f%z","level":"%l",%v})"
                            : "%Y-%m-%d %H:%M:%S.%e %l %v");
}
Log::~Log() = default;

void Log::write(int level, std::string_view event, LogFields fields) const {
  const auto spd_level = static_cast<spdlog::level::level_enum>(level);
  if (!logger_->should_log(spd_level)) return;
  logger_->log(spd_level, json_ ? json_line(event, fields) : text_line(event, fields));
}

void Log::debug(std::string_view event, LogFields fields) const {
  write(SPDLOG_LEVEL_DEBUG, event, fields);
}
void Log::info(std::string_view event, LogFields fields) const {
  write(SPDLOG_LEVEL_INFO, event, fields);
}
void Log::warning(std::string_view event, LogFields fields) const {
  write(SPDLOG_LEVEL_WARN, event, fields);
}
void Log::error(std::string_view event, LogFields fields) const {
  write(SPDLOG_LEVEL_ERROR, event, fields);
}

}  // namespace heliograph::server
