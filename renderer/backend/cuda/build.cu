// The GPU programs that build trees: the steps of kernels/bvh_build.h, and the sorting between
// them.
#include "renderer/backend/cuda/build_launch.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

constexpr u32 kWarp = 32;
constexpr u32 kAll = 0xffffffff;
static_assert(kWindow == kWarp);

__device__ u32 thread() { return blockIdx.x * blockDim.x + threadIdx.x; }
__device__ u32 lane() { return threadIdx.x % kWarp; }
__device__ u32 lanes_before() { return (1u << lane()) - 1; }

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

}  // namespace

namespace {

/// Stores the box of a block's thread, and bounds of all.
__device__ void note_box(const BuildLaunch& l, const BvhBox& box) {
  __shared__ u32 least[12];
  if (threadIdx.x < 12) least[threadIdx.x] = kAll;
  __syncthreads();
  u32 own[12];
  for (u32& bound : own) bound = kAll;
  if (thread() < l.tree.count) l.boxes[thread()] = box;
  if (!box.empty())
    for (u32 k = 0; k < 3; ++k) {
      own[k] = ordered_bits(box.lower[k]);
      own[3 + k] = ordered_bits(-box.upper[k]);
      own[6 + k] = ordered_bits(box.center()[k]);
      own[9 + k] = ordered_bits(-box.center()[k]);
    }
  for (u32 b = 0; b < 12; ++b) {
    for (u32 step = kWarp / 2; step > 0; step /= 2)
      own[b] = min(own[b], __shfl_down_sync(kAll, own[b], step));
    if (lane() == 0) atomicMin(&least[b], own[b]);
  }
  __syncthreads();
  static_assert(offsetof(BuildHead, center_upper) == 9 * sizeof(u32));
  if (threadIdx.x < 12) atomicMin(&l.tree.head->lower[0] + threadIdx.x, least[threadIdx.x]);
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_boxes(const __grid_constant__ BuildLaunch l) {
  BvhBox box = no_box();
  if (thread() < l.tree.count) {
    const InstanceView& instance = l.instances[thread()];
    box = ray_box(instance, l.motion_keys, l.mesh_boxes[instance.mesh]);
  }
  note_box(l, box);
}

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_triangle_boxes(const __grid_constant__ BuildLaunch l) {
  note_box(l, thread() < l.tree.count ? triangle_box(l.mesh, thread()) : no_box());
}

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_keys(const __grid_constant__ BuildLaunch l) {
  const u32 i = thread();
  if (i >= l.tree.count) return;
  l.keys[0][i] = morton_key(*l.tree.head, l.boxes[i]);
  l.order[0][i] = i;
}

// How many keys of each block have which digit.
extern "C" __global__ void __launch_bounds__(kSortThreads)
    sort_count(const __grid_constant__ BuildLaunch l, u32 pass) {
  __shared__ u32 counts[kSortDigits];
  for (u32 d = threadIdx.x; d < kSortDigits; d += kSortThreads) counts[d] = 0;
  __syncthreads();
  const u32 begin = blockIdx.x * kSortKeys, end = min(begin + kSortKeys, l.tree.count);
  for (u32 i = begin + threadIdx.x; i < end; i += kSortThreads)
    atomicAdd(&counts[digit_of(l.keys[pass % 2][i], pass)], 1);
  __syncthreads();
  for (u32 d = threadIdx.x; d < kSortDigits; d += kSortThreads)
    l.digits[d * l.sort_blocks + blockIdx.x] = counts[d];
}

// Where each block's keys of each digit go. One block.
extern "C" __global__ void __launch_bounds__(1024)
    sort_scan(const __grid_constant__ BuildLaunch l) {
  const u32 count = kSortDigits * l.sort_blocks;
  u32 before = 0;
  for (u32 begin = 0; begin < count; begin += 1024) {
    const u32 i = begin + threadIdx.x;
    const u32 own = i < count ? l.digits[i] : 0;
    const Scanned scanned = scan_block<1024>(own);
    if (i < count) l.digits[i] = before + scanned.before;
    before += scanned.all;
  }
}

// Moves keys of a digit behind each other in the order in which they are.
extern "C" __global__ void __launch_bounds__(kSortThreads)
    sort_move(const __grid_constant__ BuildLaunch l, u32 pass) {
  constexpr u32 kWarps = kSortThreads / kWarp, kRows = kSortKeys / kSortThreads;
  __shared__ u32 places[kWarps][kSortDigits];
  for (u32 i = threadIdx.x; i < kWarps * kSortDigits; i += kSortThreads)
    places[i / kSortDigits][i % kSortDigits] = 0;
  __syncthreads();
  const u32 warp = threadIdx.x / kWarp;
  const u32 begin = blockIdx.x * kSortKeys + warp * kWarp * kRows + lane();
  u64 keys[kRows];
  u32 ranks[kRows];
#pragma unroll
  for (u32 row = 0; row < kRows; ++row) {
    const u32 i = begin + row * kWarp;
    const bool is_there = i < l.tree.count;
    keys[row] = is_there ? l.keys[pass % 2][i] : 0;
    const u32 digit = is_there ? digit_of(keys[row], pass) : kSortDigits;
    const u32 same = __match_any_sync(kAll, digit);
    ranks[row] = __popc(same & lanes_before());
    if (is_there) ranks[row] += places[warp][digit];
    __syncwarp();
    if (is_there && (same & lanes_before()) == 0) places[warp][digit] += __popc(same);
    __syncwarp();
  }
  __syncthreads();
  for (u32 d = threadIdx.x; d < kSortDigits; d += kSortThreads) {
    u32 place = l.digits[d * l.sort_blocks + blockIdx.x];
    for (u32 w = 0; w < kWarps; ++w) {
      const u32 count = places[w][d];
      places[w][d] = place;
      place += count;
    }
  }
  __syncthreads();
#pragma unroll
  for (u32 row = 0; row < kRows; ++row) {
    const u32 i = begin + row * kWarp;
    if (i >= l.tree.count) continue;
    const u32 to = places[warp][digit_of(keys[row], pass)] + ranks[row];
    l.keys[1 - pass % 2][to] = keys[row];
    l.order[1 - pass % 2][to] = l.order[pass % 2][i];
  }
}

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_leaves(const __grid_constant__ BuildLaunch l, u32 again) {
  const u32 i = thread();
  if (i >= l.tree.count) return;
  if (again)
    restart_leaf(l.tree, i);
  else
    build_leaf(l.tree, i);
}

namespace {

/// A warp's work on a node of the radix tree.
__device__ void join(const BuildView& view, const BuildRange& range, ClusterWindow& window) {
  const float scale = area_scale(*view.head);
  const u32 most = most_left(view, range);
  BuildCluster own = child_cluster(view, range, lane() < kWarp / 2, lane() % (kWarp / 2));
  for (;;) {
    const u32 there = __ballot_sync(kAll, own.node != kNone);
    if (own.node != kNone) put_cluster(view, window, __popc(there & lanes_before()), own);
    if (lane() == 0) window.count = __popc(there);
    __syncwarp();
    if (u32(__popc(there)) <= most) break;
    if (lane() < window.count) find_nearest(window, lane(), scale);
    __syncwarp();
    own = lane() < window.count ? join_cluster(view, window, lane(), scale)
                                : BuildCluster{kNone, kNone};
    __syncwarp();
  }
  leave_cluster(view, range, window, lane());
  __threadfence();
  __syncwarp();
}

}  // namespace

// A thread goes up from each item until another has to come to the same node.
extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_clusters(const __grid_constant__ BuildLaunch l, u32 again) {
  __shared__ ClusterWindow windows[kBuildThreads / kWarp];
  const BuildView& view = l.tree;
  if (again && !view.head->balances) return;
  const u32 count = view.head->count;
  BuildRange range{thread(), thread(), thread()};
  bool goes_on = thread() < count && count > 1;
  while (__any_sync(kAll, goes_on)) {
    if (goes_on) {
      bool is_left = false;
      const u32 place = parent_place(view, range, is_left);
      __threadfence();
      const u32 other = atomicExch(&view.ends[place], is_left ? range.first : range.last);
      __threadfence();
      goes_on = other != kNone;
      if (goes_on) range = parent_range(range, is_left, other);
    }
    u32 lanes = __ballot_sync(kAll, goes_on && is_joined(view, range));
    for (; lanes != 0; lanes &= lanes - 1) {
      const int from = __ffs(int(lanes)) - 1;
      join(view,
           {__shfl_sync(kAll, range.first, from), __shfl_sync(kAll, range.last, from),
            __shfl_sync(kAll, range.split, from)},
           windows[threadIdx.x / kWarp]);
    }
    if (range.size() == count) goes_on = false;
  }
}

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_level(const __grid_constant__ BuildLaunch l, u32 level) {
  BuildHead& head = *l.tree.head;
  const u32 below = first_task(head, level + 1);
  for (u32 i = thread(); i < head.level_nodes[level]; i += gridDim.x * blockDim.x)
    build_wide(l.tree, level_task(l.tree, level, i), [&](const BuildTask& task) {
      l.tree.tasks[below + atomicAdd(&head.level_nodes[level + 1], 1)] = task;
    });
}

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_items(const __grid_constant__ BuildLaunch l) {
  const u32 i = thread();
  if (i >= l.tree.count) return;
  const u32 number = l.tree.items[i];
  const InstanceView& instance = l.instances[number];
  l.items[i] = bvh_instance(instance, number, l.meshes[instance.mesh]);
  l.item_of_instance[number] = i;
}

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_triangles(const __grid_constant__ BuildLaunch l) {
  const u32 i = thread();
  if (i >= l.tree.count) return;
  const u32 number = l.tree.items[i];
  if (l.triangles)
    l.triangles[i] = bvh_triangle(l.mesh, number);
  else
    l.triangle_numbers[i] = number;
}
