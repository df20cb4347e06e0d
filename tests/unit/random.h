// Reproducible uniform numbers for the statistical tests of kernels.
#pragma once

#include <random>

#include "kernels/core/math.h"

namespace heliograph::test {

/// Uniform in [0, 1), a multiple of 2^-24.
class Random {
 public:
  explicit Random(kernels::u32 seed = 1) : engine_(seed) {}
  float next() { return float(engine_() >> 8) * 0x1p-24f; }
  kernels::vec2 next2() {
    const float x = next();
    return {x, next()};
  }

 private:
  std::mt19937 engine_;
};

}  // namespace heliograph::test
