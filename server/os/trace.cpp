#include "server/os/trace.h"

#include <algorithm>

namespace heliograph::server {
namespace {

constexpr std::size_t kLength = 55;  // of a traceparent of version 00
constexpr std::size_t kLongestState = 512;

bool is_hex(std::string_view text) {
  return std::ranges::all_of(
      text, [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}
bool is_zero(std::string_view text) {
  return std::ranges::all_of(text, [](char c) { return c == '0'; });
}

/// Checks the fixed part; a later version may append more after a dash.
bool is_parent(std::string_view text) {
  if (text.size() < kLength) return false;
  const std::string_view version = text.substr(0, 2);
  if (!is_hex(version) || version == "ff") return false;
  if (text.size() > kLength && (version == "00" || text[kLength] != '-')) return false;
  if (text[2] != '-' || text[35] != '-' || text[52] != '-') return false;
  const std::string_view trace = text.substr(3, 32), span = text.substr(36, 16);
  return is_hex(trace) && is_hex(span) && is_hex(text.substr(53, 2)) && !is_zero(trace) &&
         !is_zero(span);
}

bool is_state(std::string_view text) {
  return text.size() <= kLongestState &&
         std::ranges::all_of(text, [](char c) { return c >= ' ' && c <= '~'; });
}

}  // namespace

Trace parse_trace(std::string_view parent, std::string_view state) {
  if (!is_parent(parent)) return {};
  // Fields that a later version appends are unknown here, so they are not passed on.
  Trace trace{.parent = std::string(parent.substr(0, kLength)), .state = ""};
  if (is_state(state)) trace.state = state;
  return trace;
}

}  // namespace heliograph::server
