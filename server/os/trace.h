// Which trace of a caller's a call is part of, by W3C Trace Context (www.w3.org/TR/trace-context).
// Taken from a call's metadata by the call log; told by logs and manifests.
#pragma once

#include <string>
#include <string_view>

namespace heliograph::server {

struct Trace {
  std::string parent;  // "00-<trace id>-<span id>-<flags>"; "": none
  std::string state;   // what vendors add, passed on as it came

  [[nodiscard]] explicit operator bool() const { return !parent.empty(); }
  /// 32 hexadecimal digits; only of a trace that there is.
  [[nodiscard]] std::string_view trace_id() const { return std::string_view(parent).substr(3, 32); }
  /// 16 of them: the caller's span, which the call is a child of.
  [[nodiscard]] std::string_view span_id() const { return std::string_view(parent).substr(36, 16); }
};

/// None where `parent` breaks the rules (length, dashes, lowercase digits, an id of zeros, version
/// ff). Of a later version what 00 has too is taken. A state that is too long or not printable is
/// left out.
[[nodiscard]] Trace parse_trace(std::string_view parent, std::string_view state);

}  // namespace heliograph::server
