// Budget of what a load may still allocate: every loader asks here before it allocates by a number
// that the file claims.
#pragma once

#include <atomic>

#include "renderer/assets/load.h"
#include "renderer/assets/refuse.h"

namespace heliograph::assets {

/// Thread: any.
class Budget {
 public:
  explicit Budget(const LoadLimits& limits) : limits_(limits) {}

  [[nodiscard]] const LoadLimits& limits() const { return limits_; }

  /// Reserves count * size bytes; RESOURCE_EXHAUSTED when the load would exceed its limit.
  void take(u64 count, u64 size, const std::string& where) {
    const u64 bytes = count > kMax / size ? kMax : count * size;
    const u64 before = used_.fetch_add(bytes > limits_.bytes ? 0 : bytes);
    if (bytes > limits_.bytes || before > limits_.bytes - bytes) {
      exceeded(where, "bytes", before > kMax - bytes ? kMax : before + bytes, limits_.bytes);
    }
  }
  /// Refuses a count above a limit of LoadLimits, by the limit's name.
  static void check(u64 count, u64 limit, const std::string& name, const std::string& where) {
    if (count > limit) exceeded(where, name, count, limit);
  }

 private:
  static constexpr u64 kMax = ~u64(0);

  [[noreturn]] static void exceeded(const std::string& where, const std::string& name, u64 needed,
                                    u64 available) {
    throw Refused{
        Error{.code = Code::kResourceExhausted,
              .message = fmt::format("would decode to {} {}, the limit is {}; reduce the asset, "
                                     "or raise the daemon's decode_ limit",
                                     needed, name, available),
              .where = where,
              .needed = needed,
              .available = available}};
  }

  const LoadLimits limits_;
  std::atomic<u64> used_{0};
};

}  // namespace heliograph::assets
