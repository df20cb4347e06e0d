// Admission control near exhaustion: the order in which kinds of work are refused, and the
// thresholds. Used by Budget::admit().
#pragma once

#include <array>
#include <atomic>
#include <functional>

#include "renderer/base/error.h"

namespace heliograph::server {

/// Kinds of work, the one refused first first.
enum class Work : u8 { kSessions, kUploads, kJobs };

/// Returns the resident set size of this process in bytes.
[[nodiscard]] u64 resident_bytes();

/// Thresholds of admission. Thread: any.
class Overload {
 public:
  struct Options {
    std::array<u64, 3> percent{85, 92, 97};  // of a total, by Work: that work is refused above it
    u64 memory_bytes = 0;                    // memory limit of the process; 0: unknown
    std::function<u64()> resident = resident_bytes;
  };
  explicit Overload(Options options) : options_(std::move(options)) {}

  /// Returns true when a total is too full for this work.
  [[nodiscard]] bool is_full(Work work, u64 used, u64 total) const;
  /// Checks that the process can take `bytes` more. RESOURCE_EXHAUSTED otherwise, with a retry time
  /// where waiting may help. Applies to every tenant: the kernel's OOM killer would spare none.
  [[nodiscard]] Status check_memory(Work work, u64 bytes) const;
  /// Returns the amount of a total that this work may fill.
  [[nodiscard]] u64 allowed(Work work, u64 total) const;

 private:
  [[nodiscard]] u64 resident() const;

  const Options options_;
  mutable std::atomic<u64> resident_ = 0;
  mutable std::atomic<i64> read_at_ = 0;  // ms of the steady clock
};

/// Returns the name of a kind of work in refusals, such as "new sessions".
[[nodiscard]] const char* name_of(Work work);

/// Retry time, seconds, of work refused for overload.
inline constexpr double kFullSeconds = 2;

}  // namespace heliograph::server
