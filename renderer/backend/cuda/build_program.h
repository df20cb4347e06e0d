// What the programs that build trees share.
#pragma once

#include "renderer/backend/cuda/build_launch.h"

namespace heliograph::cuda {

inline constexpr u32 kWarp = 32;
inline constexpr u32 kAll = 0xffffffff;  // lanes of a warp

__device__ inline u32 thread() { return blockIdx.x * blockDim.x + threadIdx.x; }
__device__ inline u32 lane() { return threadIdx.x % kWarp; }
__device__ inline u32 lanes_before() { return (1u << lane()) - 1; }

/// Whether a tree is to be built: none was there that could be refitted.
__device__ inline bool builds(const BuildLaunch& l) {
  return !l.before.nodes || l.before.head->builds != 0;
}

}  // namespace heliograph::cuda
