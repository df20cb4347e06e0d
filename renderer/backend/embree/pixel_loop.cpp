// Chooses the pixel loops.
#include "renderer/backend/embree/pixel_loop.h"

namespace heliograph::embree {

const PixelLoops& best_pixel_loops() {
  if (__builtin_cpu_supports("x86-64-v3")) return kPixelLoopsV3;
  return kPixelLoopsV2;
}

}  // namespace heliograph::embree
