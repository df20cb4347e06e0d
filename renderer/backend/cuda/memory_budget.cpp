#include "renderer/backend/cuda/memory_budget.h"

#include <fmt/format.h>

namespace heliograph::cuda {

std::optional<u64> MemoryBudget::try_take(u64 bytes) {
  const std::lock_guard lock(mutex_);
  if (bytes > bytes_ - used_) return bytes_ - used_;
  used_ += bytes;
  return std::nullopt;
}

Status MemoryBudget::take(u64 bytes) {
  for (;;) {
    const auto available = try_take(bytes);
    if (!available) return {};
    if (bytes > bytes_ || !give_up_()) return std::unexpected(no_device_memory(bytes, *available));
  }
}

void MemoryBudget::give_back(u64 bytes) {
  const std::lock_guard lock(mutex_);
  used_ -= bytes;
}

void MemoryBudget::give_up() {
  while (give_up_()) {
  }
}

u64 MemoryBudget::used() const {
  const std::lock_guard lock(mutex_);
  return used_;
}

Error no_device_memory(u64 needed, u64 available) {
  Error error{.code = Code::kResourceExhausted,
              .message = fmt::format(
                  "needs {} bytes of the GPU's memory, {} are available; render smaller scenes or "
                  "images or fewer at once, let go of frames on the GPU, or raise --device-memory",
                  needed, available),
              .where = ""};
  error.needed = needed;
  error.available = available;
  return error;
}

}  // namespace heliograph::cuda
