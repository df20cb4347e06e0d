#include "renderer/backend/cuda/twins.h"

#include <sys/mman.h>

#include <algorithm>
#include <cassert>

#include "renderer/base/parallel.h"

namespace heliograph::cuda {
namespace {

constexpr u64 kStep = 2 << 20;     // bytes: a large page
constexpr unsigned kNoTiming = 2;  // CU_EVENT_DISABLE_TIMING
constexpr unsigned kMapped = 2;    // CU_MEMHOSTREGISTER_DEVICEMAP

/// Memory of whole steps, in large pages where there are such; null: there is none.
std::byte* map_steps(u64 bytes) {
  void* all =
      ::mmap(nullptr, bytes + kStep, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (all == MAP_FAILED) return nullptr;
  auto* begin = static_cast<std::byte*>(all);
  const u64 before = (kStep - reinterpret_cast<std::uintptr_t>(all) % kStep) % kStep;
  if (before > 0) ::munmap(begin, before);
  begin += before;
  ::munmap(begin + bytes, kStep - before);
  (void)::madvise(begin, bytes, MADV_HUGEPAGE);
  return begin;
}

/// Fresh pages are zeroed when they are first written: by all threads, not by the one that locks
/// them.
void touch(std::span<std::byte> bytes) {
  constexpr u64 kPage = 4096;
  run_alone([&] {
    parallel_for(bytes.size() / kStep, [&](u64 step) {
      for (u64 at = step * kStep; at < (step + 1) * kStep; at += kPage) bytes[at] = std::byte();
    });
  });
}

}  // namespace

std::shared_ptr<const Twin> Twins::take(u64 bytes, StreamHandle writer) {
  const u64 size = (bytes + kStep - 1) / kStep * kStep;
  std::optional<Twin> twin = find_unused(size);
  if (!twin) twin = open(size);
  if (!twin) return nullptr;
  if (!comes_after(*twin, writer)) {
    close(*twin);
    return nullptr;
  }
  {
    const std::lock_guard lock(mutex_);
    in_use_.emplace(twin->host, *twin);
  }
  return {new Twin(*twin), [self = shared_from_this()](const Twin* used) {
            self->give_back(*used);
            delete used;
          }};
}

bool Twins::comes_after(const Twin& twin, StreamHandle writer) const {
  const auto held = device_.tenure.hold();
  return held && device_.driver.set_context(device_.context) == 0 &&
         device_.driver.let_stream_wait(writer, twin.read, 0) == 0;
}

/// The smallest that is large enough, and not twice as large.
std::optional<Twin> Twins::find_unused(u64 bytes) {
  const std::lock_guard lock(mutex_);
  auto best = unused_.end();
  for (auto each = unused_.begin(); each != unused_.end(); ++each)
    if (each->bytes >= bytes && each->bytes < 2 * bytes &&
        (best == unused_.end() || each->bytes < best->bytes))
      best = each;
  if (best == unused_.end()) return std::nullopt;
  const Twin twin = *best;
  unused_.erase(best);
  return twin;
}

std::optional<Twin> Twins::open(u64 bytes) {
  const auto has_room = [&] {
    const std::lock_guard lock(mutex_);
    if (bytes_ + bytes > most_) return false;
    bytes_ += bytes;
    return true;
  };
  if (!has_room() && !(reclaim() && has_room())) return std::nullopt;
  Twin twin{.bytes = bytes};
  if (allocate(twin)) return twin;
  close(twin);
  return std::nullopt;
}

bool Twins::allocate(Twin& twin) {
  twin.host = map_steps(twin.bytes);
  if (!twin.host) return false;
  touch({twin.host, twin.bytes});
  const Driver& driver = device_.driver;
  // Without the tenure: others may give up theirs for it.
  if (!device_.pool.take(twin.bytes)) return false;
  const auto held = device_.tenure.hold();
  if (!held || driver.set_context(device_.context) != 0 ||
      device_.pool.allocate(&twin.device, twin.bytes) != 0) {
    device_.pool.give_back(twin.bytes);
    return false;
  }
  return driver.create_event(&twin.read, kNoTiming) == 0 &&
         driver.record_event(twin.read, device_.stream) == 0 &&
         driver.pin(twin.host, twin.bytes, kMapped) == 0 &&
         driver.pinned_at(&twin.host_there, twin.host, 0) == 0;
}

/// The pool outlives the context, which takes the rest with it.
void Twins::close(const Twin& twin) {
  if (const auto held = device_.tenure.hold()) {
    const Driver& driver = device_.driver;
    (void)driver.set_context(device_.context);
    if (twin.read) (void)driver.destroy_event(twin.read);
    if (twin.host) (void)driver.unpin(twin.host);
  }
  if (twin.device) device_.pool.release(twin.device, twin.bytes);
  if (twin.host) ::munmap(twin.host, twin.bytes);
  const std::lock_guard lock(mutex_);
  bytes_ -= twin.bytes;
}

void Twins::give_back(const Twin& twin) {
  const std::lock_guard lock(mutex_);
  in_use_.erase(twin.host);
  unused_.push_back(twin);
}

bool Twins::reclaim() {
  std::vector<Twin> unused;
  {
    const std::lock_guard lock(mutex_);
    unused.swap(unused_);
  }
  std::ranges::for_each(unused, [&](const Twin& twin) { close(twin); });
  return !unused.empty();
}

Twins::~Twins() { (void)reclaim(); }

std::optional<Twin> Twins::find(std::span<const std::byte> host) const {
  const std::lock_guard lock(mutex_);
  auto next = in_use_.upper_bound(host.data());
  if (host.empty() || next == in_use_.begin()) return std::nullopt;
  const Twin& twin = std::prev(next)->second;
  const u64 offset = u64(host.data() - twin.host);
  if (offset + host.size() > twin.bytes) return std::nullopt;
  return twin;
}

Status Twins::copy(DevicePointer to, std::span<const std::byte> host) const {
  const Driver& driver = device_.driver;
  const auto twin = find(host);
  assert(twin);
  const u64 offset = u64(host.data() - twin->host);
  Result result = driver.copy(to, twin->device + offset, host.size(), device_.stream);
  if (result == 0) result = driver.record_event(twin->read, device_.stream);
  if (result == 0) return {};
  return fail(Code::kUnavailable, "", "a copy failed: " + driver.describe(result));
}

}  // namespace heliograph::cuda
