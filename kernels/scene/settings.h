// Settings of a render request for the kernels.
#pragma once

#include "kernels/core/platform.h"

namespace heliograph::kernels {

enum class PixelFilter : u8 { kBox, kTent, kGaussian, kBlackmanHarris };

struct Settings {
  u64 seed;
  u32 max_depth;         // path edges: 1 = emission seen directly, 2 = direct light
  u32 roulette_depth;    // path edges before Russian roulette begins; kNone: never
  float clamp;           // largest radiance of one contribution; +inf: none
  float clamp_indirect;  // of one after three edges or more
  bool regularize;       // glossy lobes behind a diffuse or rough scattering are rougher
  PixelFilter filter;
  bool transparent_background;
  bool through_transmission;
  u32 vertex;  // of the path through a pixel's centre, that centre planes show; 0: the first
};

}  // namespace heliograph::kernels
