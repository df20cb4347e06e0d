// Rays of paths, and those of light towards them.
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

// Whose registers hold a walk.
constexpr int kTraceBlocks = kRichRays ? 6 : 7;

/// Lanes of a warp that still walk before those that are done take new rays.
constexpr int kLanesKept = 20;
/// Lanes that still look for something to meet before those that found it do.
constexpr int kLanesSearching = 12;

/// The warps of a launch share out rays. Few rays are spread over all warps, as lanes of a warp
/// wait for each other.
struct Share {
  u32 warp;   // this one's number
  u32 warps;  // of all
  u32 rays;   // that each takes at first
};

/// Walks the rays [0, count) of a queue. A lane takes the next one when its own is done, once
/// enough others of its warp are; and it meets triangles once enough others have some.
///
/// next    how many are taken after the first ones
/// begin   (walk, i): begins it
/// end     (walk, i, whether): it is done; called by all lanes of a warp
/// Source: Aila and Laine 2009, "Understanding the Efficiency of Ray Traversal on GPUs", HPG,
/// section 4.
template <class Begin, class End>
__device__ void walk_all(const WaveLaunch& l, const Share& share, u32 count, u32& next,
                         const Begin& begin, const End& end) {
  const u32 begun = share.warps * share.rays;
  BvhStack stack;
  BvhWalk walk(l.shot.view.scene, l.shot.bvh, stack);
  BvhGroup items{0, 0};  // found, and not met yet
  u32 ray = kNone;
  bool walks = false, more = true, is_first = true;
  while (true) {
    const bool is_done = ray != kNone && !walks;
    end(walk, ray, is_done);
    if (is_done) ray = kNone;
    const u32 idle = __ballot_sync(kAll, ray == kNone && lane() < share.rays);
    if (more && idle) {
      u32 first = share.warp * share.rays;
      if (!is_first) {
        if (lane() == 0) first = begun + atomicAdd(&next, u32(__popc(int(idle))));
        first = __shfl_sync(kAll, first, 0);
      }
      is_first = false;
      const u32 own = first + u32(__popc(int(idle & lanes_before())));
      more = max(begun, first + u32(__popc(int(idle)))) < count;
      if ((idle >> lane() & 1) && own < count) {
        ray = own;
        walks = true;
        begin(walk, ray);
      }
    }
    if (!__any_sync(kAll, walks)) return;
    const int least = more ? kLanesKept : 1;
    do {
      do {
        if (walks && items.bits == 0) {
          items = walk.take_items();
          if (items.bits == 0) walks = walk.goes_on();
        }
      } while (__popc(int(__ballot_sync(kAll, walks && items.bits == 0))) >= kLanesSearching);
      if (walks && items.bits != 0) {
        walk.meet(items);
        items.bits = 0;
        walks = walk.goes_on();
      }
    } while (__popc(int(__ballot_sync(kAll, walks))) >= least);
  }
}

/// Where a ray goes.
template <bool kMany>
__device__ void go_to_scene(BvhWalk& walk, const WaveShot& shot) {
  if constexpr (kMany) walk.go_to(shot.view.scene, shot.bvh);
}

template <bool kMany>
__device__ void trace_paths(const WaveLaunch& l, const Share& share) {
  WaveRound& now = l.counters->rounds[l.round];
  const u32* active = l.active[l.round];
  walk_all(
      l, share, now.active, now.next_ray,
      [&](BvhWalk& walk, u32 i) {
        const PathRay ray = load_whole(l.wave.rays[active[i]]);
        go_to_scene<kMany>(walk, shot_of<kMany>(l, active[i]));
        walk.begin(ray.ray, ray.mask, false);
      },
      [&](const BvhWalk& walk, u32 i, bool is_done) {
        const Hit hit = walk.hit();
        const bool hits = hit.instance != kNone;
        const Places at = take_places(now.hits, is_done && hits, is_done && !hits);
        if (!is_done) return;
        store_whole(l.wave.hits[active[i]], WaveHit{hit});
        l.arrived[hits ? at.first : items_of(l.work) - 1 - at.second] = active[i];
      });
}

/// Called, so that the walk need not keep what this does in registers.
template <bool kMany>
__noinline__ __device__ void shine(const WaveLaunch& l, u32 item) {
  const WaveShot& shot = shot_of<kMany>(l, item);
  const BvhTracer tracer(shot.view.scene, shot.bvh);
  Wave(shot.view, l.work, l.wave, tracer).shine(item);
}

template <bool kMany>
__device__ void trace_lights(const WaveLaunch& l, const Share& share) {
  WaveRound& now = l.counters->rounds[l.round];
  walk_all(
      l, share, now.lights, now.next_light,
      [&](BvhWalk& walk, u32 i) {
        go_to_scene<kMany>(walk, shot_of<kMany>(l, l.lit[i]));
        walk.begin(load_whole(l.wave.lights[l.lit[i]]).ray, kShadowRay, true);
      },
      [&](const BvhWalk& walk, u32 i, bool is_done) {
        if (is_done && walk.hit().instance == kNone) shine<kMany>(l, l.lit[i]);
      });
}

/// Paths by the first warps and light by the last ones; who is done helps the others.
template <bool kMany>
__device__ void trace_all(const WaveLaunch& l) {
  const WaveRound& now = l.counters->rounds[l.round];
  Share share{thread() / kWarp, threads() / kWarp, 0};
  share.rays = min2((now.active + now.lights + share.warps - 1) / share.warps, kWarp);
  trace_paths<kMany>(l, share);
  share.warp = share.warps - 1 - share.warp;
  trace_lights<kMany>(l, share);
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kThreads, kTraceBlocks)
    HELIO_PROGRAM(wave_trace)(const __grid_constant__ WaveLaunch l) {
  trace_all<false>(l);
}
extern "C" __global__ void __launch_bounds__(kThreads, kTraceBlocks)
    HELIO_PROGRAM(wave_trace_many)(const __grid_constant__ WaveLaunch l) {
  trace_all<true>(l);
}
