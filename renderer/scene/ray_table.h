// The rays of a camera that has one for each pixel.
#pragma once

#include "renderer/scene/components.h"

namespace heliograph {

/// Row-major, of as many pixels as its camera; checked where it was read from a message.
struct RayTable {
  ArrayOf<kernels::TableRay> rays;
  ArrayOf<float> times;  // seconds after the shutter's opening, >= 0; empty: all 0
  bool interpolated = false;
  kernels::RayTableView view;  // of these arrays
  double last_time = 0;        // of `times`
};

}  // namespace heliograph
