// Voxels that are written to a volume file, and those that were read of it.
#pragma once

#include <algorithm>

#include "renderer/scene/components.h"

namespace heliograph::test {

/// Value of a voxel; 0 where there is none.
[[nodiscard]] inline float voxel(const Grid& grid, ivec3 at, u32 channel = 0) {
  const auto bricks = grid.bricks.span();
  const auto brick = std::ranges::find(bricks, at >> 3);
  if (brick == bricks.end()) return 0;
  const ivec3 in = at & 7;
  const auto row = std::size_t(brick - bricks.begin()) * kBrickVoxels +
                   std::size_t((in.x * 8 + in.y) * 8 + in.z);
  return grid.values[row * grid.channels + channel];
}

/// Calls with every voxel of a box that spans several bricks, on both sides of 0.
template <class Visit>
void each_voxel(const Visit& visit) {
  for (int x = -9; x < 7; ++x)
    for (int y = -3; y < 10; ++y)
      for (int z = 5; z < 18; ++z) visit(ivec3(x, y, z));
}
[[nodiscard]] inline int count_at(ivec3 at) { return (at.x * 7 + at.y * 3 + at.z * 5 + 200) % 16; }

}  // namespace heliograph::test
