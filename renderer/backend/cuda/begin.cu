// How paths begin.
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

/// Begins items in the free slots, as many as there are of both.
template <bool kMany>
__device__ void begin_all(const WaveLaunch& l) {
  WaveRound& now = l.counters->rounds[l.round];
  WaveRound& next = l.counters->rounds[1 - l.round];
  const u32 free = l.all_free ? l.slots : now.free;
  const u32 count = min2(free, items_of(l.work) - now.first_item);
  if (thread() == 0) next.first_item = now.first_item + count;
  for (u32 i = thread(); i < count; i += threads()) {
    const u32 slot = l.all_free ? i : l.free[l.round][i];
    const u32 item = now.first_item + i;
    const WaveShot& shot = shot_of<kMany>(l, item);
    const CalledTracer tracer{{shot.view.scene, shot.bvh}};
    if (Wave(shot.view, l.work, l.wave, tracer).begin(slot, item))
      l.active[l.round][atomicAdd(&now.active, 1)] = slot;
    else
      l.free[1 - l.round][atomicAdd(&next.free, 1)] = slot;
  }
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kThreads)
    HELIO_PROGRAM(wave_begin)(const __grid_constant__ WaveLaunch l) {
  begin_all<false>(l);
}
extern "C" __global__ void __launch_bounds__(kThreads)
    HELIO_PROGRAM(wave_begin_many)(const __grid_constant__ WaveLaunch l) {
  begin_all<true>(l);
}
