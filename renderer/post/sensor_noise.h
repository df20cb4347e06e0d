// Random numbers of sensor models: a stream of its own for every pixel. Called by sensor_*.cpp.
#pragma once

#include "renderer/base/types.h"

namespace heliograph {

/// The random numbers of one pixel; the same for the same seed and pixel.
class SensorNoise {
 public:
  SensorNoise(u64 seed, u64 pixel);
  [[nodiscard]] double uniform();  // in (0, 1)
  [[nodiscard]] double normal();   // mean 0, variance 1
  [[nodiscard]] double poisson(double mean);

 private:
  u64 key_;
  u64 next_ = 0;
};

}  // namespace heliograph
