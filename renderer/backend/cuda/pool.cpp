#include "renderer/backend/cuda/pool.h"

#include <algorithm>
#include <limits>

namespace heliograph::cuda {
namespace {

constexpr int kReleaseThreshold = 4;  // CU_MEMPOOL_ATTR_RELEASE_THRESHOLD
constexpr int kReserved = 5;          // CU_MEMPOOL_ATTR_RESERVED_MEM_CURRENT
constexpr u64 kStep = 512;            // the driver's

u64 rounded(u64 bytes) { return (bytes + kStep - 1) / kStep * kStep; }

}  // namespace

Result Pool::open(const PoolOwner& owner) {
  owner_ = owner;
  if (const Result result = driver_.default_pool(&handle_, owner.device)) return result;
  u64 keep = std::numeric_limits<u64>::max();
  return driver_.set_pool(handle_, kReleaseThreshold, &keep);
}

u64 Pool::taken() const {
  const std::lock_guard lock(mutex_);
  return taken_;
}

Status Pool::take(u64 bytes) {
  HELIO_TRY(budget_.take(rounded(bytes)));
  shrink();
  return {};
}

void Pool::shrink() {
  u64 reserved = 0;
  const u64 own = taken(), all = std::max(own, budget_.used());
  // As if nothing that the pool keeps served what was taken last: only the driver knows.
  if (driver_.pool_value(handle_, kReserved, &reserved) == 0 && reserved > own &&
      reserved + (all - own) > budget_.bytes())
    trim();
}

void Pool::give_back(u64 bytes) { budget_.give_back(rounded(bytes)); }

Result Pool::allocate(DevicePointer* at, u64 bytes) {
  Result result = driver_.allocate(at, bytes, owner_.stream);
  if (result == kOutOfMemory) {  // others have memory of the device, too
    budget_.give_up();
    trim();
    result = driver_.allocate(at, bytes, owner_.stream);
  }
  if (result != 0) return result;
  const std::lock_guard lock(mutex_);
  live_.insert(*at);
  taken_ += rounded(bytes);
  return result;
}

void Pool::release(DevicePointer at, u64 bytes) {
  {
    const std::lock_guard lock(mutex_);
    if (!is_closed_ && driver_.set_context(owner_.context) == 0 &&
        driver_.release(at, owner_.stream) == 0) {
      taken_ -= rounded(bytes);
      live_.erase(at);
    }
  }
  give_back(bytes);
}

void Pool::trim() {
  (void)driver_.wait_for_stream(owner_.stream);
  (void)driver_.trim_pool(handle_, 0);
}

std::vector<DevicePointer> Pool::close() {
  const std::lock_guard lock(mutex_);
  is_closed_ = true;
  return {live_.begin(), live_.end()};
}

}  // namespace heliograph::cuda
