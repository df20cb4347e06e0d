#include "renderer/backend/embree/support.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "renderer/base/parallel.h"

namespace heliograph::embree {
namespace {

constexpr u32 axis_count(u32 steps) { return 2 * steps * steps + 2 * steps + 1; }

/// Directions whose z is not negative, and how far points reach along them and against them.
template <u32 N>
struct Axes {
  std::array<float, N> x, y, z;
};
template <u32 N>
struct Ranges {
  std::array<float, N> least, most;

  Ranges() {
    least.fill(INFINITY);
    most.fill(-INFINITY);
  }
  void extend(const Axes<N>& axes, vec3 p) {
    for (u32 i = 0; i < N; ++i) {
      const float along = axes.x[i] * p.x + axes.y[i] * p.y + axes.z[i] * p.z;
      least[i] = std::min(least[i], along);
      most[i] = std::max(most[i], along);
    }
  }
  void extend(const Ranges& other) {
    for (u32 i = 0; i < N; ++i) {
      least[i] = std::min(least[i], other.least[i]);
      most[i] = std::max(most[i], other.most[i]);
    }
  }
};

}  // namespace

Support::Support(std::span<const vec3> points) {
  constexpr u32 kAxes = axis_count(kSteps);
  constexpr std::size_t kChunk = 1 << 14;
  if (points.empty()) return;
  Axes<kAxes> axes;
  u32 count = 0;
  for (int x = -kSteps; x <= kSteps; ++x) {
    const int rest = kSteps - std::abs(x);
    for (int y = -rest; y <= rest; ++y, ++count) {
      axes.x[count] = float(x) / kSteps;
      axes.y[count] = float(y) / kSteps;
      axes.z[count] = float(rest - std::abs(y)) / kSteps;
    }
  }
  std::vector<Ranges<kAxes>> chunks((points.size() + kChunk - 1) / kChunk);
  parallel_for(chunks.size(), [&](std::size_t c) {
    const std::size_t first = c * kChunk;
    Ranges<kAxes> ranges;
    for (const vec3& p : points.subspan(first, std::min(kChunk, points.size() - first)))
      ranges.extend(axes, p);
    chunks[c] = ranges;
  });
  Ranges<kAxes> all;
  for (const auto& ranges : chunks) all.extend(ranges);
  for (u32 i = 0; i < kAxes; ++i) {
    const int x = int(axes.x[i] * kSteps), y = int(axes.y[i] * kSteps);
    reach_[0][x + kMiddle][y + kMiddle] = all.most[i];
    reach_[1][kMiddle - x][kMiddle - y] = -all.least[i];
    farthest_ = std::max({farthest_, all.most[i], -all.least[i]});
  }
}

float Support::along(vec3 direction) const {
  const vec3 size = glm::abs(direction);
  const float sum = size.x + size.y + size.z;
  if (!(sum > 0)) return 0;
  const float x = size.x / sum * kSteps, y = size.y / sum * kSteps;
  const int column = int(x), row = int(y);
  const float right = x - float(column), up = y - float(row);
  const auto& half = reach_[direction.z < 0];
  const auto reach = [&](int i, int j) {
    return half[kMiddle + (direction.x < 0 ? -i : i)][kMiddle + (direction.y < 0 ? -j : j)];
  };
  const float aside[2] = {reach(column + 1, row), reach(column, row + 1)};
  const float between =
      right + up <= 1 ? reach(column, row) * (1 - right - up) + aside[0] * right + aside[1] * up
                      : reach(column + 1, row + 1) * (right + up - 1) + aside[0] * (1 - up) +
                            aside[1] * (1 - right);
  return between * sum;
}

Box Support::under(const mat4x3& map) const {
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    const vec3 row(map[0][axis], map[1][axis], map[2][axis]);
    const float largest = farthest_ * (std::abs(row.x) + std::abs(row.y) + std::abs(row.z));
    const float margin = (largest + std::abs(map[3][axis])) * 0x1p-20f;
    box.lower[axis] = map[3][axis] - along(-row) - margin;
    box.upper[axis] = map[3][axis] + along(row) + margin;
  }
  return box;
}

}  // namespace heliograph::embree
