// Code that the programs that build trees share.
#pragma once

#include "renderer/backend/cuda/build_launch.h"
#include "renderer/backend/cuda/lanes.h"

namespace heliograph::cuda {

/// True if a tree is to be built: none was there that could be refitted.
__device__ inline bool builds(const BuildLaunch& l) {
  return !l.before.nodes || l.before.head->builds != 0;
}

}  // namespace heliograph::cuda
