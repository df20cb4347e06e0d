// Arguments of the program that makes instances. Read by place.cu.
#pragma once

#include "kernels/geometry/place.h"

namespace heliograph::cuda {

using kernels::u32;

inline constexpr u32 kPlaceThreads = 128;  // of a block

/// Everything lies in device memory.
struct PlaceLaunch {
  const kernels::SlotView* slots;
  const kernels::mat4x3* world;  // by entity
  const kernels::MotionKey* motion_keys;
  kernels::InstanceView* instances;  // the result, by slot
  u32 count;
};

}  // namespace heliograph::cuda
