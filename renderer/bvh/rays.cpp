#include "renderer/bvh/rays.h"

namespace heliograph::bvh {

const RayFunctions& best_rays() {
  if (__builtin_cpu_supports("x86-64-v3")) return kRaysV3;
  return kRaysV2;
}

}  // namespace heliograph::bvh
