// The GPU programs that sort boxes by their keys, between the steps of build.cu.
#include "renderer/backend/cuda/build_program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

/// The sum over the threads of a block before this one, and over all.
struct Scanned {
  u32 before, all;
};
template <u32 kThreads>
__device__ Scanned scan_block(u32 own) {
  __shared__ u32 sums[kWarp];
  u32 sum = own;
  for (u32 step = 1; step < kWarp; step *= 2) {
    const u32 other = __shfl_up_sync(kAll, sum, step);
    if (lane() >= step) sum += other;
  }
  __syncthreads();
  if (lane() == kWarp - 1) sums[threadIdx.x / kWarp] = sum;
  __syncthreads();
  u32 before = 0, all = 0;
  for (u32 warp = 0; warp < kThreads / kWarp; ++warp) {
    if (warp < threadIdx.x / kWarp) before += sums[warp];
    all += sums[warp];
  }
  return {before + sum - own, all};
}

__device__ u32 digit_of(u64 key, u32 pass) {
  return u32(key >> (pass * kSortBits)) & (kSortDigits - 1);
}

constexpr u32 kWarps = kSortThreads / kWarp, kRows = kSortKeys / kSortThreads;

/// Keys of one digit by the warps of a block; then where the first of them goes.
using Places = u32[kWarps][kSortDigits];

/// The keys of a thread, `kWarp` apart.
struct Rows {
  u64 keys[kRows];
  u32 order[kRows];
  u32 ranks[kRows];  // among those of the same warp and digit
};

/// Place of a thread's row among those that a block sorts.
__device__ u32 row_place(u32 row) {
  return threadIdx.x / kWarp * kWarp * kRows + row * kWarp + lane();
}

/// Ranks keys within their warps, and counts them. All threads of a block.
///
/// count   of the block's keys
__device__ void rank_rows(Rows& rows, Places& places, u32 count, u32 pass) {
  for (u32 warp = 0; warp < kWarps; ++warp) places[warp][threadIdx.x] = 0;
  __syncthreads();
  u32* own = places[threadIdx.x / kWarp];
  HELIO_UNROLL
  for (u32 row = 0; row < kRows; ++row) {
    const bool is_there = row_place(row) < count;
    const u32 digit = is_there ? digit_of(rows.keys[row], pass) : kSortDigits;
    const u32 same = __match_any_sync(kAll, digit);
    rows.ranks[row] = __popc(same & lanes_before());
    if (is_there) rows.ranks[row] += own[digit];
    __syncwarp();
    if (is_there && (same & lanes_before()) == 0) own[digit] += __popc(same);
    __syncwarp();
  }
  __syncthreads();
}

/// Number of the block's keys that have the thread's digit.
__device__ u32 keys_of_digit(const Places& places) {
  u32 count = 0;
  for (u32 warp = 0; warp < kWarps; ++warp) count += places[warp][threadIdx.x];
  return count;
}
/// Counts to places, from where the block's first key of the thread's digit goes.
__device__ void set_places(Places& places, u32 place) {
  for (u32 warp = 0; warp < kWarps; ++warp) {
    const u32 count = places[warp][threadIdx.x];
    places[warp][threadIdx.x] = place;
    place += count;
  }
  __syncthreads();
}
__device__ u32 row_target(const Rows& rows, const Places& places, u32 row, u32 pass) {
  return places[threadIdx.x / kWarp][digit_of(rows.keys[row], pass)] + rows.ranks[row];
}

// A block's sums of a pass: nothing yet, its own keys of a digit, or with this bit those of all
// blocks up to it after all keys of lower digits.
constexpr u32 kNotYet = 0xffffffff, kWhole = 1u << 31;
static_assert(kMostBuildBoxes < kWhole - 1);

/// Place for the block's first key of the thread's digit, by the sums of the blocks before it.
/// They have all begun: none of them waits for this one.
///
/// Source: Merrill and Garland 2016, "Single-pass Parallel Prefix Scan with Decoupled Look-back";
/// Adinets and Merrill 2022, "Onesweep: A Faster Least Significant Digit Radix Sort for GPUs".
__device__ u32 look_back(const BuildLaunch& l, u32 pass, u32 block, u32 own) {
  volatile u32* sums = l.sums + u64(pass) * l.sort_blocks * kSortDigits + threadIdx.x;
  u32 before = 0;
  if (block == 0)
    before = scan_block<kSortThreads>(l.counts->digits[pass][threadIdx.x] + 1).before;
  else
    sums[u64(block) * kSortDigits] = own;
  for (u32 other = block; other > 0;) {
    const u32 sum = sums[u64(other - 1) * kSortDigits];
    if (sum == kNotYet) continue;
    before += sum & ~kWhole;
    if (sum & kWhole) break;
    --other;
  }
  sums[u64(block) * kSortDigits] = kWhole | (before + own);
  return before;
}

}  // namespace

// Keys of boxes, and how many of all have which digit in which pass.
extern "C" __global__ void __launch_bounds__(kSortThreads)
    build_keys(const __grid_constant__ BuildLaunch l) {
  __shared__ u32 counts[kSortPasses][kSortDigits];
  if (!builds(l)) return;
  for (u32 pass = 0; pass < kSortPasses; ++pass) counts[pass][threadIdx.x] = 0;
  __syncthreads();
  const u32 begin = blockIdx.x * kSortKeys, end = min(begin + kSortKeys, l.tree.count);
  for (u32 i = begin + threadIdx.x; i < end; i += kSortThreads) {
    const u64 key = morton_key(*l.tree.head, l.boxes[i]);
    l.keys[0][i] = key;
    l.order[0][i] = i;
    for (u32 pass = 0; pass < kSortPasses; ++pass) atomicAdd(&counts[pass][digit_of(key, pass)], 1);
  }
  __syncthreads();
  for (u32 pass = 0; pass < kSortPasses; ++pass)
    if (const u32 count = counts[pass][threadIdx.x]; count > 0)
      atomicAdd(&l.counts->digits[pass][threadIdx.x], count);
}

// Moves keys of a digit behind each other in the order in which they are.
extern "C" __global__ void __launch_bounds__(kSortThreads)
    sort_pass(const __grid_constant__ BuildLaunch l, u32 pass) {
  __shared__ Places places;
  __shared__ u32 block;
  if (!builds(l)) return;
  if (threadIdx.x == 0) block = atomicAdd(&l.counts->blocks[pass], 1) + 1;
  __syncthreads();
  const u32 begin = block * kSortKeys, count = min(kSortKeys, l.tree.count - begin);
  Rows rows;
  HELIO_UNROLL
  for (u32 row = 0; row < kRows; ++row) {
    if (row_place(row) >= count) continue;
    rows.keys[row] = l.keys[pass % 2][begin + row_place(row)];
    rows.order[row] = l.order[pass % 2][begin + row_place(row)];
  }
  rank_rows(rows, places, count, pass);
  set_places(places, look_back(l, pass, block, keys_of_digit(places)));
  HELIO_UNROLL
  for (u32 row = 0; row < kRows; ++row) {
    if (row_place(row) >= count) continue;
    const u32 to = row_target(rows, places, row, pass);
    l.keys[1 - pass % 2][to] = rows.keys[row];
    l.order[1 - pass % 2][to] = rows.order[row];
  }
}

// Keys of few boxes, all passes of their sort, and the leaves. One block.
extern "C" __global__ void __launch_bounds__(kSortThreads)
    sort_few(const __grid_constant__ BuildLaunch l) {
  __shared__ Places places;
  __shared__ u64 keys[kSortKeys];
  __shared__ u32 order[kSortKeys];
  if (!builds(l)) return;
  const u32 count = l.tree.count;
  for (u32 i = threadIdx.x; i < count; i += kSortThreads) {
    keys[i] = morton_key(*l.tree.head, l.boxes[i]);
    order[i] = i;
  }
  for (u32 pass = 0; pass < kSortPasses; ++pass) {
    __syncthreads();
    Rows rows;
    HELIO_UNROLL
    for (u32 row = 0; row < kRows; ++row) {
      if (row_place(row) >= count) continue;
      rows.keys[row] = keys[row_place(row)];
      rows.order[row] = order[row_place(row)];
    }
    rank_rows(rows, places, count, pass);
    set_places(places, scan_block<kSortThreads>(keys_of_digit(places)).before);
    HELIO_UNROLL
    for (u32 row = 0; row < kRows; ++row) {
      if (row_place(row) >= count) continue;
      const u32 to = row_target(rows, places, row, pass);
      keys[to] = rows.keys[row];
      order[to] = rows.order[row];
    }
  }
  __syncthreads();
  for (u32 i = threadIdx.x; i < count; i += kSortThreads) {
    l.keys[0][i] = keys[i];
    l.order[0][i] = order[i];
  }
  __syncthreads();
  for (u32 i = threadIdx.x; i < count; i += kSortThreads) build_leaf(l.tree, i);
}
