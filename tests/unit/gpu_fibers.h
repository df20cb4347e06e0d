// GPU programs on the host, for tests of what they compute: each thread of a block is a fiber, each
// block runs on a thread of its own, several at once. A .cu file is included after this.
#pragma once

#include <ucontext.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "kernels/core/platform.h"

namespace heliograph::test {

using kernels::u32;
using kernels::u64;

struct Index {
  u32 x = 0;
};
inline thread_local Index block_index, thread_index;
inline Index block_size, grid_size;

/// Who meets: a warp or a block.
struct Meeting {
  u32 members = 0, here = 0, met = 0;
  void leave() {
    if (--members > 0 && here == members) open();
  }
  void open() {
    here = 0;
    ++met;
  }
};

/// A block whose threads take turns: each runs until it waits for others.
class FiberBlock {
 public:
  explicit FiberBlock(const std::function<void()>& program) : program_(program) {
    warps_.resize((block_size.x + 31) / 32);
    fibers_.resize(block_size.x);
    for (u32 i = 0; i < block_size.x; ++i) {
      ++all_.members;
      ++warps_[i / 32].meeting.members;
      Fiber& fiber = fibers_[i];
      fiber.stack = std::make_unique<std::byte[]>(kStack);
      getcontext(&fiber.context);
      fiber.context.uc_stack = {.ss_sp = fiber.stack.get(), .ss_flags = 0, .ss_size = kStack};
      fiber.context.uc_link = &scheduler_;
      makecontext(&fiber.context, &FiberBlock::enter, 0);
    }
  }
  void run() {
    running = this;
    for (u32 left = block_size.x; left > 0;)
      for (u32 i = 0; i < block_size.x; ++i) {
        if (fibers_[i].done) continue;
        thread_index.x = i;
        swapcontext(&scheduler_, &fibers_[i].context);
        left -= fibers_[i].done;
      }
    running = nullptr;
  }
  void meet_all() { meet(all_); }
  void meet_warp() { meet(warps_[thread_index.x / 32].meeting); }
  /// What the lanes of a warp say, and which of them are there.
  std::array<u64, 32> exchange(u64 own, u32& there) {
    Warp& warp = warps_[thread_index.x / 32];
    const u32 lane = thread_index.x % 32;
    warp.said[lane] = own;
    warp.there |= 1u << lane;
    meet_warp();
    const auto said = warp.said;
    there = warp.there;
    meet_warp();
    warp.there = 0;
    meet_warp();
    return said;
  }

  static inline thread_local FiberBlock* running = nullptr;

 private:
  static constexpr std::size_t kStack = 64 << 10;
  struct Fiber {
    ucontext_t context;
    std::unique_ptr<std::byte[]> stack;
    bool done = false;
  };
  struct Warp {
    Meeting meeting;
    std::array<u64, 32> said{};
    u32 there = 0;
  };
  static void enter() {
    FiberBlock& block = *running;
    const u32 i = thread_index.x;
    block.program_();
    block.fibers_[i].done = true;
    block.all_.leave();
    block.warps_[i / 32].meeting.leave();
  }
  void meet(Meeting& meeting) {
    const u32 i = thread_index.x, before = meeting.met;
    if (++meeting.here == meeting.members) return meeting.open();
    while (meeting.met == before) swapcontext(&fibers_[i].context, &scheduler_);
  }

  const std::function<void()>& program_;
  Meeting all_;
  std::vector<Warp> warps_;
  std::vector<Fiber> fibers_;
  ucontext_t scheduler_{};
};

/// Runs a program by `blocks` of `threads`.
inline void run_on_fibers(u32 blocks, u32 threads, const std::function<void()>& program) {
  grid_size.x = blocks;
  block_size.x = threads;
  std::atomic<u32> next = 0;
  const auto work = [&] {
    for (u32 i; (i = next.fetch_add(1)) < blocks;) {
      block_index.x = i;
      FiberBlock(program).run();
    }
  };
  std::vector<std::jthread> workers;
  for (u32 i = 0; i < 3; ++i) workers.emplace_back(work);
}

}  // namespace heliograph::test

// What CUDA has and C++ has not.
// NOLINTBEGIN(readability-identifier-naming): the names are CUDA's

#define __global__
#define __device__
#define __shared__ static thread_local
#define __launch_bounds__(threads)
#define __grid_constant__
#define blockIdx heliograph::test::block_index
#define threadIdx heliograph::test::thread_index
#define blockDim heliograph::test::block_size
#define gridDim heliograph::test::grid_size

inline void __syncthreads() { heliograph::test::FiberBlock::running->meet_all(); }
inline void __syncwarp() { heliograph::test::FiberBlock::running->meet_warp(); }
inline void __nanosleep(heliograph::u32) {}
inline void __threadfence() { std::atomic_thread_fence(std::memory_order_seq_cst); }
inline auto said_by_warp(heliograph::u64 own) {
  heliograph::u32 there = 0;
  auto said = heliograph::test::FiberBlock::running->exchange(own, there);
  return std::pair(said, there);
}
inline heliograph::u32 lane_of_fiber() { return threadIdx.x % 32; }
inline heliograph::u32 __shfl_sync(heliograph::u32, heliograph::u32 own, heliograph::u32 from) {
  return heliograph::u32(said_by_warp(own).first[from]);
}
inline heliograph::u32 __shfl_up_sync(heliograph::u32, heliograph::u32 own, heliograph::u32 step) {
  const heliograph::u32 lane = lane_of_fiber();
  return heliograph::u32(said_by_warp(own).first[lane >= step ? lane - step : lane]);
}
inline heliograph::u32 __shfl_down_sync(heliograph::u32, heliograph::u32 own,
                                        heliograph::u32 step) {
  const heliograph::u32 lane = lane_of_fiber();
  return heliograph::u32(said_by_warp(own).first[lane + step < 32 ? lane + step : lane]);
}
inline heliograph::u32 __ballot_sync(heliograph::u32, bool own) {
  const auto [said, there] = said_by_warp(own);
  heliograph::u32 bits = 0;
  for (heliograph::u32 i = 0; i < 32; ++i)
    if (there >> i & 1 && said[i]) bits |= 1u << i;
  return bits;
}
inline bool __any_sync(heliograph::u32, bool own) { return __ballot_sync(0, own) != 0; }
inline heliograph::u32 __match_any_sync(heliograph::u32, heliograph::u32 own) {
  const auto [said, there] = said_by_warp(own);
  heliograph::u32 bits = 0;
  for (heliograph::u32 i = 0; i < 32; ++i)
    if (there >> i & 1 && said[i] == own) bits |= 1u << i;
  return bits;
}
inline heliograph::u32 atomicAdd(heliograph::u32* at, heliograph::u32 by) {
  return std::atomic_ref(*at).fetch_add(by);
}
inline heliograph::u32 atomicExch(heliograph::u32* at, heliograph::u32 value) {
  return std::atomic_ref(*at).exchange(value);
}
inline void atomicMin(heliograph::u32* at, heliograph::u32 value) {
  std::atomic_ref to(*at);
  for (auto now = to.load(); value < now && !to.compare_exchange_weak(now, value);) {
  }
}
inline int __popc(heliograph::u32 bits) { return std::popcount(bits); }
inline int __ffs(int bits) { return __builtin_ffs(bits); }
using std::min;
// NOLINTEND(readability-identifier-naming)
