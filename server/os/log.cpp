// Log lines. Called from everywhere in server/.
#include "server/os/log.h"

#include <fmt/chrono.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>

namespace heliograph::server {
namespace {

using std::chrono::microseconds;

constexpr std::array<std::string_view, 5> kLevels = {"debug", "info", "warning", "error", "off"};

/// Code points that change how a line looks, not what it says: controls (C0, DEL, C1), marks of
/// direction, of lines and of nothing, interlinear and tag characters.
bool is_invisible(u32 c) {
  struct Range {
    u32 first, last;
  };
  constexpr Range kRanges[] = {{0x00, 0x1f},     {0x7f, 0x9f},      {0xad, 0xad},
                               {0x61c, 0x61c},   {0x180e, 0x180e},  {0x200b, 0x200f},
                               {0x2028, 0x202e}, {0x2060, 0x206f},  {0xfeff, 0xfeff},
                               {0xfff0, 0xffff}, {0xe0000, 0xe0fff}};
  return std::ranges::any_of(kRanges,
                             [c](Range range) { return c >= range.first && c <= range.last; });
}

struct CodePoint {
  u32 value = 0;
  std::size_t bytes = 0;  // 0: no UTF-8
};

/// The first of a text that is not empty.
CodePoint first_of(std::string_view text) {
  const auto byte = [&](std::size_t i) { return u32(static_cast<unsigned char>(text[i])); };
  const u32 lead = byte(0);
  if (lead < 0x80) return {lead, 1};
  const std::size_t bytes = lead >= 0xf0 ? 4 : lead >= 0xe0 ? 3 : 2;
  if (lead < 0xc2 || lead > 0xf4 || text.size() < bytes) return {};
  u32 value = lead & (0x7fu >> bytes);
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return {};
    value = value << 6 | (byte(i) & 0x3f);
  }
  constexpr std::array<u32, 5> kLeast = {0, 0, 0x80, 0x800, 0x10000};
  const bool is_surrogate = value >= 0xd800 && value < 0xe000;
  return value < kLeast[bytes] || value > 0x10ffff || is_surrogate ? CodePoint()
                                                                   : CodePoint{value, bytes};
}

void append_escape(std::string& out, u32 c) {
  if (c < 0x10000) {
    out += fmt::format("\\u{:04x}", c);
    return;
  }
  const u32 rest = c - 0x10000;
  out += fmt::format("\\u{:04x}\\u{:04x}", 0xd800 + (rest >> 10), 0xdc00 + (rest & 0x3ff));
}

}  // namespace

std::string quoted(std::string_view value, u64 bytes) {
  std::string out = "\"";
  while (!value.empty()) {
    const CodePoint c = first_of(value);
    const std::size_t size = std::max<std::size_t>(c.bytes, 1);
    if (size > bytes) {
      out += fmt::format("... {} bytes more", value.size());
      break;
    }
    if (c.bytes == 0)
      out += fmt::format("\\\\x{:02x}", static_cast<unsigned char>(value.front()));
    else if (is_invisible(c.value))
      append_escape(out, c.value);
    else if (c.value == '"' || c.value == '\\')
      (out += '\\') += char(c.value);
    else
      out += value.substr(0, size);
    value.remove_prefix(size);
    bytes -= size;
  }
  return out += '"';
}

Log::Log(std::string_view level, bool json, Limits limits, int fd)
    : level_(Level(std::ranges::find(kLevels, level) - kLevels.begin())),
      json_(json),
      limits_(limits),
      writer_(fd, limits.bytes, [this](u64 lines) {
        return line(Level::kWarning, "log lines were dropped: nobody read them",
                    {{"lines", lines}});
      }) {}

void Log::write(Level level, std::string_view event, LogFields fields) const {
  if (level >= level_) writer_.write(line(level, event, fields));
}

std::string Log::line(Level level, std::string_view event, LogFields fields) const {
  const auto now = std::chrono::system_clock::now();
  const auto micros =
      std::chrono::duration_cast<microseconds>(now.time_since_epoch()).count() % 1'000'000;
  const std::tm time = fmt::localtime(std::chrono::system_clock::to_time_t(now));
  const std::string_view name = kLevels[std::size_t(level)];
  std::string out;
  if (json_) {
    const std::string offset = fmt::format("{:%z}", time);  // "+0100"
    const std::string zone = fmt::format("{}:{}", offset.substr(0, 3), offset.substr(3));
    out = fmt::format(R"({{"time":"{:%Y-%m-%dT%H:%M:%S}.{:06}{}","level":"{}","event":{})", time,
                      micros, zone, name, quoted(event, limits_.value_bytes));
  } else {
    out = fmt::format("{:%Y-%m-%d %H:%M:%S}.{:03} {} {}", time, micros / 1000, name, event);
  }
  for (const LogField& field : fields) {
    const std::string value = quoted(field.value, limits_.value_bytes);
    out += json_ ? fmt::format(R"(,"{}":{})", field.name, value)
                 : fmt::format(" {}={}", field.name, value);
  }
  return out += json_ ? "}\n" : "\n";
}

void Log::debug(std::string_view event, LogFields fields) const {
  write(Level::kDebug, event, fields);
}
void Log::info(std::string_view event, LogFields fields) const {
  write(Level::kInfo, event, fields);
}
void Log::warning(std::string_view event, LogFields fields) const {
  write(Level::kWarning, event, fields);
}
void Log::error(std::string_view event, LogFields fields) const {
  write(Level::kError, event, fields);
}

}  // namespace heliograph::server
