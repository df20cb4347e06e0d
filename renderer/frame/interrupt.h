// When work is given up. Asked by all that takes long.
#pragma once

#include <chrono>
#include <optional>
#include <stop_token>

#include "renderer/base/error.h"

namespace heliograph {

using TimePoint = std::chrono::steady_clock::time_point;

/// Conditions for giving up. Checked between pieces of work of at most some milliseconds.
struct Interrupt {
  std::stop_token stop;
  std::optional<TimePoint> deadline;

  [[nodiscard]] bool requested() const {
    return stop.stop_requested() || (deadline && std::chrono::steady_clock::now() >= *deadline);
  }
  /// CANCELLED or DEADLINE_EXCEEDED once requested.
  [[nodiscard]] Status status() const {
    if (stop.stop_requested()) return fail(Code::kCancelled, "", "cancelled by the client");
    if (requested()) return fail(Code::kDeadlineExceeded, "", "the deadline passed");
    return {};
  }
};

}  // namespace heliograph
