// The GPU programs that build trees: the steps of kernels/bvh/bvh_build.h. Sorting between them is
// in sort.cu.
#include "renderer/backend/cuda/build_program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

static_assert(kWindow == kWarp);

// ---------------------------------------------------------------- boxes

namespace {

__device__ bool is_left_out(const BuildLaunch& l, u32 instance) {
  return l.left_out && (l.left_out[instance / 32] >> (instance % 32) & 1) != 0;
}

__device__ BvhBox instance_box(const BuildLaunch& l, u32 number) {
  if (is_left_out(l, number)) return no_box();
  const InstanceView& instance = l.instances[number];
  return ray_box(instance, l.motion_keys, l.mesh_boxes[instance.mesh]);
}

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
  if (!builds(l)) return;
  note_box(l, thread() < l.tree.count ? instance_box(l, thread()) : no_box());
}

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_triangle_boxes(const __grid_constant__ BuildLaunch l) {
  if (!builds(l)) return;
  note_box(l, thread() < l.tree.count ? primitive_box(l.mesh, thread()) : no_box());
}

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_leaves(const __grid_constant__ BuildLaunch l) {
  if (builds(l) && thread() < l.tree.count) build_leaf(l.tree, thread());
}

// ---------------------------------------------------------------- the tree

namespace {

/// A warp's work on a node of the radix tree.
__device__ void join(const BuildView& view, const BuildRange& range, ClusterWindow& window) {
  const float scale = area_scale(*view.head);
  const u32 most = most_left(view, range.size());
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
  if (!builds(l) || (again && !view.head->balances)) return;
  const u32 count = view.head->count;
  BuildRange range{thread(), thread(), thread()};
  bool goes_on = thread() < count && count > 1;
  while (__any_sync(kAll, goes_on)) {
    if (goes_on) {
      bool is_left = false;
      const u32 place = parent_place(view, range, is_left);
      __threadfence();
      const u32 other = atomicExch(end_at(view, place), is_left ? range.first : range.last);
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

namespace {

/// Leaves a task to whoever takes it.
__device__ void put_task(const BuildView& view, const BuildTask& task) {
  BuildTask& to = view.tasks[atomicAdd(&view.head->tasks, 1)];
  to.number = task.number;
  to.first_child = task.first_child;
  to.first_item = task.first_item;
  __threadfence();
  *const_cast<volatile u32*>(&to.node) = task.node;
}
/// True if the task is there.
__device__ bool take_task(const BuildView& view, u32 i, BuildTask& task) {
  if (i == 0) {
    task = root_task(view);
    return true;
  }
  const u32 node = *const_cast<volatile const u32*>(&view.tasks[i].node);
  if (node == kNone) return false;
  __threadfence();
  task = view.tasks[i];
  return true;
}

}  // namespace

// Each task comes from one with a lower number. As a warp takes the next ones when it is done with
// what it has, the lowest that is not done is with a warp that runs, and there: nobody waits for
// ever.
extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_nodes(const __grid_constant__ BuildLaunch l) {
  if (!builds(l)) return;
  const BuildView& view = l.tree;
  const u32 count = wide_nodes(view);
  for (;;) {
    u32 first = 0;
    if (lane() == 0) first = atomicAdd(&view.head->taken, kWarp);
    first = __shfl_sync(kAll, first, 0);
    if (first >= count) break;
    bool waits = first + lane() < count;
    while (__any_sync(kAll, waits)) {
      BuildTask task;
      const bool is_there = waits && take_task(view, first + lane(), task);
      if (!__any_sync(kAll, is_there)) __nanosleep(100);  // who makes them needs the memory more
      if (!is_there) continue;
      build_wide(view, task, [&](const BuildTask& next) { put_task(view, next); });
      waits = false;
    }
  }
}

namespace {

__device__ void put_item(const BuildLaunch& l, u32 i, u32 number) {
  const InstanceView& instance = l.instances[number];
  l.items[i] = bvh_instance(instance, number, l.meshes[instance.mesh]);
  l.item_of_instance[number] = i;
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_items(const __grid_constant__ BuildLaunch l) {
  const u32 i = thread();
  if (!builds(l) || i >= l.tree.count) return;
  put_item(l, i, l.tree.items ? l.tree.items[i] : i);  // there may be no tree
}

namespace {

__device__ void put_triangle(const BuildLaunch& l, u32 i, u32 number) {
  if (l.triangles)
    l.triangles[i] = bvh_triangle(l.mesh, number);
  else
    l.triangle_numbers[i] = number;
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kBuildThreads)
    build_triangles(const __grid_constant__ BuildLaunch l) {
  const u32 i = thread();
  if (builds(l) && i < l.tree.count) put_triangle(l, i, l.tree.items[i]);
}

// ---------------------------------------------------------------- refitting

namespace {

/// Takes up where an item of the tree that was there is now.
__device__ void refit_item(const BuildLaunch& l, u32 i, const BvhBox& box) {
  l.before.boxes[i] = box;
  if ((i < l.before.tree->items) == box.empty()) l.before.head->fits = 0;
  if (i > 0 && i < l.before.tree->nodes) l.tree.parents[i] = l.before.parents[i];
}

}  // namespace

// Boxes of what is in the tree that was there, and its items as they are now.
extern "C" __global__ void __launch_bounds__(kBuildThreads)
    refit_items(const __grid_constant__ BuildLaunch l) {
  const u32 i = thread();
  if (i >= l.tree.count) return;
  const u32 number = l.before.items[i].instance;
  refit_item(l, i, instance_box(l, number));
  put_item(l, i, number);
}
extern "C" __global__ void __launch_bounds__(kBuildThreads)
    refit_triangles(const __grid_constant__ BuildLaunch l) {
  const u32 i = thread();
  if (i >= l.tree.count) return;
  const u32 number =
      l.before.triangles ? l.before.triangles[i].number : l.before.triangle_numbers[i];
  refit_item(l, i, primitive_box(l.mesh, number));
  put_triangle(l, i, number);
}

// A thread begins at each node that is over items alone, and goes up until another has to come to
// the same node.
extern "C" __global__ void __launch_bounds__(kBuildThreads)
    refit_nodes(const __grid_constant__ BuildLaunch l) {
  const Refit& before = l.before;
  u32 node = thread();
  if (node >= before.tree->nodes || before.nodes[node].inner != 0 || before.head->fits == 0) return;
  const RefitView view{before.nodes, before.boxes, l.tree.item_cost, before.refitted, l.tree.wide};
  const float scale = refit_scale(*before.nodes);
  for (;;) {
    refit_node(view, node, scale);
    if (node == 0) break;
    node = before.parents[node];
    __threadfence();
    const u32 done = atomicAdd(&before.done[node], 1) + 2;
    if (done < count_bits(before.nodes[node].inner)) return;
    __threadfence();
  }
  *l.tree.tree = *before.tree;
  if (is_good(before.refitted[0], before.tree->cost, scale)) before.head->builds = 0;
}
