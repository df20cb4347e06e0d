// What paths do where they arrive.
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

extern "C" __global__ void __launch_bounds__(kThreads, 4)
    wave_arrive(const __grid_constant__ WaveLaunch l) {
  const CalledTracer tracer{{l.shot.scene, l.bvh}};
  const Wave wave(l.shot, l.work, l.wave, tracer);
  WaveRound& now = l.counters->rounds[l.round];
  WaveRound& next = l.counters->rounds[1 - l.round];
  const u32 active = now.active, hits = now.hits;
  for (u32 i = thread(); i < active; i += threads()) {
    const u32 slot = l.arrived[i < hits ? i : l.slots - 1 - (i - hits)];
    const Arrival arrival = wave.arrive(slot);
    if (arrival.goes_on)
      l.active[1 - l.round][atomicAdd(&next.active, 1)] = slot;
    else
      l.free[1 - l.round][atomicAdd(&next.free, 1)] = slot;
    if (arrival.takes_light) l.lit[atomicAdd(&now.lights, 1)] = slot;
  }
}
