// The choice by the noise of each tile and its neighbours.
#include "renderer/schedule/adaptive.h"

#include <algorithm>
#include <numeric>

namespace heliograph {
namespace {

/// f(j) of a tile and of its up to eight neighbours, ascending; tiles are in row-major order.
template <class F>
void for_each_near(u32 across, u32 count, u32 tile, F&& f) {
  const u32 x = tile % across, y = tile / across, down = count / across;
  for (u32 v = y - std::min(y, 1u); v <= std::min(y + 1, down - 1); ++v)
    for (u32 u = x - std::min(x, 1u); u <= std::min(x + 1, across - 1); ++u) f(v * across + u);
}

}  // namespace

std::vector<u32> noisy_tiles(const std::vector<float>& noise, u32 across, double target) {
  if (target == 0)
    target = std::accumulate(noise.begin(), noise.end(), 0.0) / double(noise.size()) / 2;
  std::vector<bool> wanted(noise.size());
  for (u32 i = 0; i < noise.size(); ++i)
    if (noise[i] > target)
      for_each_near(across, u32(noise.size()), i, [&](u32 near) { wanted[near] = true; });
  std::vector<u32> tiles;
  for (u32 i = 0; i < noise.size(); ++i)
    if (wanted[i]) tiles.push_back(i);
  return tiles;
}

}  // namespace heliograph
