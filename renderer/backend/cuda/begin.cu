// How paths begin.
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

// Begins items in the free slots, as many as there are of both.
extern "C" __global__ void __launch_bounds__(kThreads)
    wave_begin(const __grid_constant__ WaveLaunch l) {
  const CalledTracer tracer{{l.shot.scene, l.bvh}};
  const Wave wave(l.shot, l.work, l.wave, tracer);
  WaveRound& now = l.counters->rounds[l.round];
  WaveRound& next = l.counters->rounds[1 - l.round];
  const u32 free = l.all_free ? l.slots : now.free;
  const u32 count = min2(free, items_of(l.work) - now.first_item);
  if (thread() == 0) next.first_item = now.first_item + count;
  for (u32 i = thread(); i < count; i += threads()) {
    const u32 slot = l.all_free ? i : l.free[l.round][i];
    if (wave.begin(slot, now.first_item + i))
      l.active[l.round][atomicAdd(&now.active, 1)] = slot;
    else
      l.free[1 - l.round][atomicAdd(&next.free, 1)] = slot;
  }
}
