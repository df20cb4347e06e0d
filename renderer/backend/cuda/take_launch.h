// Arguments of the programs that take numbers. Read by take.cu.
#pragma once

#include "kernels/ingest/take.h"

namespace heliograph::cuda {

using kernels::u32;
using kernels::u64;

inline constexpr u32 kTakeThreads = 256;  // of a block

struct TakeLaunch {
  const void* from;
  float* device;  // the result, there
  float* host;    // the same, and the next, in the host's memory as the device sees it
  u32* wrong;     // becomes 1 where something is
  u64 count;      // of floats, or of matrices
};

}  // namespace heliograph::cuda
