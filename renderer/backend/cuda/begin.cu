// How paths begin.
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

template <bool kMany>
__device__ void begin_all(const WaveLaunch& l) {
  for (u32 item = thread(); item < items_of(l.work); item += threads()) {
    const WaveShot& shot = shot_of<kMany>(l, item);
    const CalledTracer<Answers::kPictures> tracer{{shot.view.scene, shot.bvh}};
    if (Wave(shot.view, l.work, l.wave, tracer).begin(item))
      l.active[l.round][atomicAdd(&l.counters->rounds[l.round].active, 1)] = item;
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
