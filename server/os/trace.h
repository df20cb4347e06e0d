// Trace context of a call, by W3C Trace Context (www.w3.org/TR/trace-context). Read from a call's
// metadata by the call log; written to logs and manifests.
#pragma once

#include <string>
#include <string_view>

namespace heliograph::server {

struct Trace {
  std::string parent;  // "00-<trace id>-<span id>-<flags>"; "": none
  std::string state;   // tracestate, passed on unchanged

  [[nodiscard]] explicit operator bool() const { return !parent.empty(); }
  /// Returns the trace id, 32 hexadecimal digits; requires a non-empty `parent`.
  [[nodiscard]] std::string_view trace_id() const { return std::string_view(parent).substr(3, 32); }
  /// Returns the caller's span id, 16 hexadecimal digits: the parent of this call.
  [[nodiscard]] std::string_view span_id() const { return std::string_view(parent).substr(36, 16); }
};

/// Returns none where `parent` breaks the rules (length, dashes, lowercase digits, zero ids,
/// version ff). From a later version it takes the fields that version 00 has. Drops a state that is
/// too long or not printable.
[[nodiscard]] Trace parse_trace(std::string_view parent, std::string_view state);

}  // namespace heliograph::server
