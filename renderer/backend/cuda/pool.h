// A device's memory: the driver's pool, within a budget.
#pragma once

#include <set>
#include <vector>

#include "renderer/backend/cuda/driver.h"
#include "renderer/backend/cuda/memory_budget.h"

namespace heliograph::cuda {

/// Owner of a pool.
struct PoolOwner {
  Device device = 0;
  ContextHandle context = nullptr;
  StreamHandle stream = nullptr;  // in whose order memory is had and freed
};

inline constexpr Result kOutOfMemory = 2;  // CUDA_ERROR_OUT_OF_MEMORY

/// Pool of device memory. Freed memory stays for what comes next, while the budget has room for it
/// beside what is in use. Memory beside the pool is of the same budget.
/// Thread: any. Asking for memory needs the owner's context, freeing enters it.
class Pool {
 public:
  explicit Pool(const Driver& driver) : driver_(driver) {}
  Pool(const Pool&) = delete;
  Pool& operator=(const Pool&) = delete;

  [[nodiscard]] Result open(const PoolOwner& owner);

  /// Room in the budget, before anything is allocated. RESOURCE_EXHAUSTED.
  [[nodiscard]] Status take(u64 bytes);
  void give_back(u64 bytes);
  /// Returns the driver's answer. Gives up what nobody uses before that is out of memory.
  ///
  /// bytes   that were taken
  [[nodiscard]] Result allocate(DevicePointer* at, u64 bytes);
  /// In the order of the stream; gives back what was taken, too.
  void release(DevicePointer at, u64 bytes);
  /// Waits for the stream, then what the pool keeps is the device's again.
  void trim();
  /// The same where the budget has no room for what the pool keeps.
  void shrink();
  /// From now on nothing is freed. Returns what is left: the pool outlives the context.
  [[nodiscard]] std::vector<DevicePointer> close();

  [[nodiscard]] MemoryBudget& budget() { return budget_; }
  [[nodiscard]] const MemoryBudget& budget() const { return budget_; }
  [[nodiscard]] PoolHandle handle() const { return handle_; }

 private:
  [[nodiscard]] u64 taken() const;

  const Driver& driver_;
  PoolHandle handle_ = nullptr;
  PoolOwner owner_;
  MemoryBudget budget_{0};
  mutable std::mutex mutex_;  // held while something is freed
  std::set<DevicePointer> live_;
  u64 taken_ = 0;  // by all live ones
  bool is_closed_ = false;
};

}  // namespace heliograph::cuda
