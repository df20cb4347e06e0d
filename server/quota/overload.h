// Admission while the daemon runs full: which work is refused first, and from where on. Asked
// through Budget::admit().
#pragma once

#include <array>
#include <atomic>
#include <functional>

#include "renderer/base/error.h"

namespace heliograph::server {

/// In the order in which they are refused.
enum class Work : u8 { kSessions, kUploads, kJobs };

/// Bytes of memory that are resident in this process.
[[nodiscard]] u64 resident_bytes();

/// Thread: any.
class Overload {
 public:
  struct Options {
    std::array<u64, 3> percent{85, 92, 97};  // of a total, by Work: above it that work is refused
    u64 memory_bytes = 0;                    // that the process may have; 0: nobody knows
    std::function<u64()> resident = resident_bytes;
  };
  explicit Overload(Options options) : options_(std::move(options)) {}

  /// Whether so much of a total is too much for this work.
  [[nodiscard]] bool is_full(Work work, u64 used, u64 total) const;
  /// RESOURCE_EXHAUSTED when the process's memory is nearly used up, or would be with so many bytes
  /// more; with a retry time where waiting may help. Nobody is spared: the kernel would not spare
  /// anybody either.
  [[nodiscard]] Status check_memory(Work work, u64 bytes) const;
  /// Room for this work in a total.
  [[nodiscard]] u64 allowed(Work work, u64 total) const;

 private:
  [[nodiscard]] u64 resident() const;

  const Options options_;
  mutable std::atomic<u64> resident_ = 0;
  mutable std::atomic<i64> read_at_ = 0;  // ms of the steady clock
};

/// "new sessions"
[[nodiscard]] const char* name_of(Work work);

/// Until there may be room again.
inline constexpr double kFullSeconds = 2;

}  // namespace heliograph::server
