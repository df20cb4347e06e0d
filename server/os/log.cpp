// Log lines. Called from everywhere in server/.
#include "server/os/log.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <array>
#include <cstddef>

#include "server/os/log_writer.h"

namespace heliograph::server {
namespace {

using Level = Log::Level;
static_assert(int(Level::kDebug) == spdlog::level::debug);
static_assert(int(Level::kError) == spdlog::level::err);

// spdlog pattern: the time, the level, and the text of payload().
constexpr const char* kText = "%Y-%m-%d %H:%M:%S.%e %l %v";
constexpr const char* kJson = R"({"time":"%Y-%m-%dT%H:%M:%S.%f%z","level":"%l","event":%v})";

/// Returns true for code points that change how a line looks, not its content: controls (C0, DEL,
/// C1), direction marks, line separators, zero-width, interlinear and tag characters.
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
  std::size_t bytes = 0;  // 0: invalid UTF-8
};

/// Decodes the first code point of a text that is not empty.
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

struct Format {
  bool json;
  u64 value_bytes;
};

std::string payload(Format format, std::string_view event, std::span<const LogField> fields) {
  std::string out = format.json ? quoted(event, format.value_bytes) : std::string(event);
  for (const LogField& field : fields) {
    const std::string value = quoted(field.value, format.value_bytes);
    out += format.json ? fmt::format(R"(,"{}":{})", field.name, value)
                       : fmt::format(" {}={}", field.name, value);
  }
  return out;
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

Log::Log(const std::string& level, bool json, Limits limits, int fd)
    : json_(json),
      value_bytes_(limits.value_bytes),
      writer_(LogWriter::start(fd, limits.bytes,
                               [format = Format{json, limits.value_bytes}](u64 lines) {
                                 const LogField count("lines", lines);
                                 return payload(format, "log lines were dropped: nobody read them",
                                                {&count, 1});
                               })),
      logger_(std::make_unique<spdlog::logger>("heliographd", writer_)) {
  logger_->set_pattern(json ? kJson : kText);
  // spdlog's default handler writes to stderr and may block.
  logger_->set_error_handler([writer = writer_](const std::string&) { writer->lose(); });
  logger_->set_level(spdlog::level::from_str(level));
}

Log::~Log() { writer_->close(); }

bool Log::is_on(Level level) const { return logger_->should_log(spdlog::level::level_enum(level)); }

void Log::write(Level level, std::string_view event, std::span<const LogField> fields) const {
  if (!is_on(level)) return;
  const std::string text = payload({json_, value_bytes_}, event, fields);
  logger_->log(spdlog::level::level_enum(level), spdlog::string_view_t(text));
}

void Log::debug(std::string_view event, LogFields fields) const {
  write(Level::kDebug, event, {fields.begin(), fields.size()});
}
void Log::info(std::string_view event, LogFields fields) const {
  write(Level::kInfo, event, {fields.begin(), fields.size()});
}
void Log::warning(std::string_view event, LogFields fields) const {
  write(Level::kWarning, event, {fields.begin(), fields.size()});
}
void Log::error(std::string_view event, LogFields fields) const {
  write(Level::kError, event, {fields.begin(), fields.size()});
}

void Log::flush() const { logger_->flush(); }
u64 Log::dropped() const { return writer_->dropped(); }
double Log::still_seconds() const { return writer_->still_seconds(); }

}  // namespace heliograph::server
