// Threads, and lanes of a warp. Called by the GPU programs beside it.
#pragma once

#include "kernels/core/platform.h"

namespace heliograph::cuda {

using kernels::u32;

inline constexpr u32 kWarp = 32;
inline constexpr u32 kAll = 0xffffffff;  // lanes of a warp

__device__ inline u32 thread() { return blockIdx.x * blockDim.x + threadIdx.x; }
__device__ inline u32 threads() { return gridDim.x * blockDim.x; }
__device__ inline u32 lane() { return threadIdx.x % kWarp; }
__device__ inline u32 lanes_before() { return (1u << lane()) - 1; }

}  // namespace heliograph::cuda
