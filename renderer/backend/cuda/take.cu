// The GPU programs that check and convert what clients wrote there.
#include "renderer/backend/cuda/take_launch.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

/// Whoever writes there may still do so: what is read once cannot differ later.
template <class T>
__device__ T read_once(const TakeLaunch& l, u64 i) {
  return static_cast<const volatile T*>(l.from)[i];
}

__device__ void put(const TakeLaunch& l, u64 i, float value) {
  l.device[i] = value;
  l.host[i] = value;
}

/// A block's poses go to the host in their order, which is one thread after the other.
template <class T>
__device__ void take_pose(const TakeLaunch& l) {
  constexpr u32 kFloats = sizeof(mat4x3) / sizeof(float);
  __shared__ float floats[kTakeThreads * kFloats];
  const u64 first = u64(blockIdx.x) * kTakeThreads;
  const u32 count = u32(l.count - first < kTakeThreads ? l.count - first : kTakeThreads);
  if (threadIdx.x < count) {
    T numbers[16];
    for (u32 i = 0; i < 16; ++i) numbers[i] = read_once<T>(l, 16 * (first + threadIdx.x) + i);
    mat4x3 pose;
    const bool good = take_affine(numbers, pose);
    if (!good || !plainly_invertible(pose)) *l.wrong = 1;
    for (u32 i = 0; i < kFloats; ++i) floats[kFloats * threadIdx.x + i] = pose[i / 3][i % 3];
  }
  __syncthreads();
  for (u32 i = threadIdx.x; i < kFloats * count; i += kTakeThreads)
    put(l, first * kFloats + i, floats[i]);
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kTakeThreads)
    take_poses(const __grid_constant__ TakeLaunch l) {
  take_pose<float>(l);
}
extern "C" __global__ void __launch_bounds__(kTakeThreads)
    take_poses_f64(const __grid_constant__ TakeLaunch l) {
  take_pose<double>(l);
}
extern "C" __global__ void __launch_bounds__(kTakeThreads)
    take_floats(const __grid_constant__ TakeLaunch l) {
  const u64 i = u64(blockIdx.x) * kTakeThreads + threadIdx.x;
  if (i >= l.count) return;
  const float x = read_once<float>(l, i);
  put(l, i, x);
  if (!is_finite(x)) *l.wrong = 1;
}
