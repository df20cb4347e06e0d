// State that lockstep.h keeps of a sample on its way.
#pragma once

#include "kernels/schedule/last_rays.h"

namespace heliograph::kernels::inline HELIO_ISA {

struct Item {
  u64 key;
  u64 pixel;
  u32 x, y;
  u32 sample;
  float time;
  Sampler sampler{0, 0};
  DrawnPairs numbers;
  DomePlace sky;  // of a ray that met nothing, where the dome has a picture
  Path path;
  Reach reach;
  Hit hit;
  Seeks seeks;  // of the path's ray
  SampleValues values;
  LaterLight light;
};

}  // namespace heliograph::kernels::inline HELIO_ISA
