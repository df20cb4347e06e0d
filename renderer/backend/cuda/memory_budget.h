// How much of a device's memory may be in use, and what makes room. Knows no driver.
#pragma once

#include <functional>
#include <mutex>
#include <optional>

#include "renderer/base/error.h"

namespace heliograph::cuda {

/// Thread: any.
class MemoryBudget {
 public:
  /// Gives up something that nobody uses; false when there is nothing more. Thread: any.
  using GiveUp = std::function<bool()>;

  explicit MemoryBudget(u64 bytes) : bytes_(bytes) {}
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  /// Before anything is taken.
  void set_bytes(u64 bytes) { bytes_ = bytes; }
  /// The same.
  void set_give_up(GiveUp give_up) { give_up_ = std::move(give_up); }

  /// RESOURCE_EXHAUSTED with what is needed and what there is, when giving up does not help;
  /// nothing is taken then. What could never fit costs nobody anything.
  [[nodiscard]] Status take(u64 bytes);
  void give_back(u64 bytes);
  /// Gives up all that nobody uses.
  void give_up();

  [[nodiscard]] u64 bytes() const { return bytes_; }
  [[nodiscard]] u64 used() const;

 private:
  /// Bytes that there are, if too few; nothing: they were taken.
  [[nodiscard]] std::optional<u64> try_take(u64 bytes);

  u64 bytes_;
  GiveUp give_up_ = [] { return false; };
  mutable std::mutex mutex_;
  u64 used_ = 0;
};

/// RESOURCE_EXHAUSTED: of the device's memory `needed` bytes are needed and `available` are there.
[[nodiscard]] Error no_device_memory(u64 needed, u64 available);

}  // namespace heliograph::cuda
