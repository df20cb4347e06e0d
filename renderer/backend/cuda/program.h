// Code that the GPU programs share: each .cu beside this file is some programs, compiled by itself.
// A thread works on an item of a wave, on a pixel or on a tile.
#pragma once

#include "kernels/bvh/bvh_tracer.h"
#include "renderer/backend/cuda/lanes.h"
#include "renderer/backend/cuda/launch.h"

// The name of a program: plain ones have one of their own.
#if defined(HELIO_PLAIN) || defined(HELIO_PLAIN_RAYS)
#define HELIO_PROGRAM(name) name##_plain
#else
#define HELIO_PROGRAM(name) name
#endif

namespace heliograph::cuda {

/// A BvhTracer whose walks are there once.
template <kernels::Answers kFor>
struct CalledTracer {
  kernels::BvhTracerFor<kFor> tracer;
  HELIO_GPU_NOINLINE __device__ kernels::Hit closest(const kernels::Ray& ray, u32 mask) const {
    return tracer.closest(ray, mask);
  }
  HELIO_GPU_NOINLINE __device__ bool occluded(const kernels::Ray& ray, u32 mask) const {
    return tracer.occluded(ray, mask);
  }
  HELIO_GPU_NOINLINE __device__ kernels::Hit closest_in(u32 instance,
                                                        const kernels::Ray& ray) const {
    return tracer.closest_in(instance, ray);
  }
};

/// Shot that an item of a wave belongs to: a program for one picture has it at hand.
template <bool kMany>
__device__ const WaveShot& shot_of(const WaveLaunch& l, u32 item) {
  if constexpr (kMany) return l.shots[kernels::picture_of(l.shot.view.film, l.work, item)];
  return l.shot;
}

/// Adds what all threads of a warp have.
__device__ inline void add_up(u32 own, u64& sum) {
  for (u32 step = kWarp / 2; step > 0; step /= 2) own += __shfl_down_sync(kAll, own, step);
  if (lane() == 0) atomicAdd(reinterpret_cast<unsigned long long*>(&sum), own);
}

/// Where a lane's entries of two queues go.
struct Places {
  u32 first, second;
};
/// Takes places for all lanes of a warp, which call it together.
///
/// count   of the first queue; that of the second one lies behind it
__device__ inline Places take_places(u32& count, bool first, bool second) {
  const u32 firsts = __ballot_sync(kAll, first), seconds = __ballot_sync(kAll, second);
  unsigned long long counts = 0;
  if (lane() == 0 && (firsts | seconds) != 0) {
    const u64 own = u32(__popc(int(firsts))) | u64(__popc(int(seconds))) << 32;
    counts = atomicAdd(reinterpret_cast<unsigned long long*>(&count), own);
  }
  counts = __shfl_sync(kAll, counts, 0);
  return {u32(counts) + u32(__popc(int(firsts & lanes_before()))),
          u32(counts >> 32) + u32(__popc(int(seconds & lanes_before())))};
}

}  // namespace heliograph::cuda
