// What the GPU programs share: each .cu beside this file is some programs, compiled by itself. A
// thread works on a slot of a wave, on a pixel or on a tile.
#pragma once

#include "kernels/bvh_tracer.h"
#include "renderer/backend/cuda/launch.h"

// The name of a program: plain ones have one of their own.
#if defined(HELIO_PLAIN) || defined(HELIO_PLAIN_RAYS)
#define HELIO_PROGRAM(name) name##_plain
#else
#define HELIO_PROGRAM(name) name
#endif

namespace heliograph::cuda {

/// A BvhTracer whose walks are there once.
struct CalledTracer {
  kernels::BvhTracer tracer;
  HELIO_CALL __device__ kernels::Hit closest(const kernels::Ray& ray, u32 mask) const {
    return tracer.closest(ray, mask);
  }
  HELIO_CALL __device__ bool occluded(const kernels::Ray& ray, u32 mask) const {
    return tracer.occluded(ray, mask);
  }
  HELIO_CALL __device__ kernels::Hit closest_in(u32 instance, const kernels::Ray& ray) const {
    return tracer.closest_in(instance, ray);
  }
};

/// What an item of a wave belongs to: a program for one picture has it at hand.
template <bool kMany>
__device__ const WaveShot& shot_of(const WaveLaunch& l, u32 item) {
  if constexpr (kMany) return l.shots[kernels::picture_of(l.shot.view.film, l.work, item)];
  return l.shot;
}
/// The same of a slot's path and of its light.
template <bool kMany>
__device__ const WaveShot& shot_of_path(const WaveLaunch& l, u32 slot) {
  return shot_of<kMany>(l, kMany ? l.wave.paths[slot].item : 0);
}
template <bool kMany>
__device__ const WaveShot& shot_of_light(const WaveLaunch& l, u32 slot) {
  return shot_of<kMany>(l, kMany ? l.wave.lights[slot].item : 0);
}

__device__ inline u32 thread() { return blockIdx.x * blockDim.x + threadIdx.x; }
__device__ inline u32 threads() { return gridDim.x * blockDim.x; }

/// Adds what all threads of a warp have.
__device__ inline void add_up(u32 own, u64& sum) {
  for (u32 step = 16; step > 0; step /= 2) own += __shfl_down_sync(0xffffffff, own, step);
  if (threadIdx.x % 32 == 0) atomicAdd(reinterpret_cast<unsigned long long*>(&sum), own);
}

}  // namespace heliograph::cuda
