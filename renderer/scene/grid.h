// Dense fields to sparse grids, and what of a grid others need to know. A header, because the
// decoder, which has no scenes, needs it too. Called by server/convert, loaders and backends.
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <tuple>

#include "renderer/scene/components.h"

namespace heliograph {

/// Voxel coordinates stay below this, so that f32 holds them to 2^-3 of a voxel.
inline constexpr i32 kLargestVoxel = 1 << 20;
/// The bricks that a grid's box may touch, there or not: lookups go through a table of them.
inline constexpr u64 kMostBricks = 1ull << 24;

/// The bricks that a box touches: [first, first + count).
struct BrickRange {
  ivec3 first;
  ivec3 count;
  [[nodiscard]] u64 size() const { return u64(count.x) * u64(count.y) * u64(count.z); }
  /// Row of a brick of this range in a table over it, z fastest.
  [[nodiscard]] u64 row(ivec3 brick) const {
    const ivec3 at = brick - first;
    return (u64(at.x) * u64(count.y) + u64(at.y)) * u64(count.z) + u64(at.z);
  }
};
[[nodiscard]] inline BrickRange brick_range(ivec3 lower, ivec3 upper) {
  const auto brick_of = [](ivec3 voxel) { return voxel >> 3; };  // rounds down
  static_assert(kBrickSide == 1 << 3);
  const ivec3 first = brick_of(lower);
  return {first, brick_of(upper - 1) - first + 1};
}

/// Order of bricks in a grid.
[[nodiscard]] inline bool brick_before(ivec3 a, ivec3 b) {
  return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
}

/// The grid of size.x * size.y * size.z voxels from (0, 0, 0) on, z fastest, `channels` numbers
/// each. Bricks of zeros are left out; values beyond the box are 0.
[[nodiscard]] inline Grid dense_grid(std::span<const float> values, ivec3 size, u32 channels) {
  Grid grid{.channels = channels, .upper = size};
  const BrickRange range = brick_range(grid.lower, grid.upper);
  std::vector<ivec3> bricks;
  std::vector<float> kept;
  std::vector<float> brick(std::size_t(kBrickVoxels) * channels);
  const auto gather = [&](ivec3 at) {
    std::ranges::fill(brick, 0.0f);
    const ivec3 first = at * kBrickSide;
    const ivec3 last = glm::min(first + kBrickSide, size);
    for (i32 x = first.x; x < last.x; ++x)
      for (i32 y = first.y; y < last.y; ++y) {
        const u64 row = ((u64(x) * u64(size.y) + u64(y)) * u64(size.z) + u64(first.z)) * channels;
        const u64 to = u64((x - first.x) * kBrickSide + y - first.y) * kBrickSide * channels;
        std::copy_n(values.data() + row, u64(last.z - first.z) * channels, brick.data() + to);
      }
    return std::ranges::any_of(brick, [](float value) { return value != 0; });
  };
  for (i32 x = 0; x < range.count.x; ++x)
    for (i32 y = 0; y < range.count.y; ++y)
      for (i32 z = 0; z < range.count.z; ++z) {
        if (!gather({x, y, z})) continue;
        bricks.emplace_back(x, y, z);
        kept.insert(kept.end(), brick.begin(), brick.end());
      }
  grid.bricks = ArrayOf<ivec3>(std::move(bricks));
  grid.values = ArrayOf<float>(std::move(kept));
  return grid;
}

/// The corners of a grid's box in object space.
[[nodiscard]] inline std::array<vec3, 8> box_corners(const Grid& grid) {
  std::array<vec3, 8> corners;
  for (u32 i = 0; i < 8; ++i) {
    const ivec3 voxel(i & 1 ? grid.upper.x : grid.lower.x, i & 2 ? grid.upper.y : grid.lower.y,
                      i & 4 ? grid.upper.z : grid.lower.z);
    corners[i] = grid.object_from_voxel * vec4(vec3(voxel), 1);
  }
  return corners;
}

}  // namespace heliograph
