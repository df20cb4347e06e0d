// Sparse grids of random numbers. Shared by the tests of volumes.
#pragma once

#include "renderer/scene/grid.h"
#include "tests/unit/random.h"

namespace heliograph::test {

/// A grid of random numbers in [0, 2), half of its bricks 0.
inline Grid random_grid(ivec3 size, u32 channels, u32 seed = 3) {
  Random random(seed);
  std::vector<float> values(std::size_t(size.x) * size.y * size.z * channels);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t voxel = i / channels;
    const i32 x = i32(voxel / (size.y * size.z)), y = i32(voxel / size.z) % size.y;
    values[i] = ((x >> 3) + (y >> 3)) % 2 ? 0 : 2 * random.next() * random.next();
  }
  return dense_grid(values, size, channels);
}

}  // namespace heliograph::test
