// What the programs that build trees share.
#pragma once

#include "renderer/backend/cuda/build_launch.h"

namespace heliograph::cuda {

inline constexpr u32 kWarp = 32;
inline constexpr u32 kAll = 0xffffffff;  // lanes of a warp

__device__ inline u32 thread() { return blockIdx.x * blockDim.x + threadIdx.x; }
__device__ inline u32 lane() { return threadIdx.x % kWarp; }
__device__ inline u32 lanes_before() { return (1u << lane()) - 1; }

}  // namespace heliograph::cuda
