// Paths that arrive.
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

// One block, whose threads then have all registers that a thread may have: so a plain program keeps
// a path there.
constexpr int kArriveThreads = 256;
constexpr int kArriveBlocks = kRich ? 2 : 1;

/// A block takes as many paths as it has threads, and then the next ones all at once: so its warps
/// run about the same instructions at a time. Each for itself they would fetch this program, which
/// is longer than a processor's cache, from far away again and again.
template <bool kMany>
__device__ void arrive_all(const WaveLaunch& l) {
  WaveRound& now = l.counters->rounds[l.round];
  WaveRound& next = l.counters->rounds[1 - l.round];
  const u32 active = now.active, hits = now.hits;
  for (u32 first = blockIdx.x * blockDim.x; first < active; first += threads()) {
    __syncthreads();
    const u32 i = first + threadIdx.x;
    u32 item = 0;
    Arrival arrival{false, false};
    if (i < active) {
      item = l.arrived[i < hits ? i : items_of(l.work) - 1 - (i - hits)];
      const WaveShot& shot = shot_of<kMany>(l, item);
      const CalledTracer<Answers::kPictures> tracer{{shot.view.scene, shot.bvh}};
      arrival = Wave(shot.view, l.work, l.wave, tracer).arrive(item);
    }
    const Places at = take_places(next.active, arrival.goes_on, arrival.wants_shadow_ray);
    if (arrival.goes_on) l.active[1 - l.round][at.first] = item;
    if (arrival.wants_shadow_ray) l.lit[at.second] = item;
  }
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kArriveThreads, kArriveBlocks)
    HELIO_PROGRAM(wave_arrive)(const __grid_constant__ WaveLaunch l) {
  arrive_all<false>(l);
}
extern "C" __global__ void __launch_bounds__(kArriveThreads, kArriveBlocks)
    HELIO_PROGRAM(wave_arrive_many)(const __grid_constant__ WaveLaunch l) {
  arrive_all<true>(l);
}
