// The choice by the noise of each tile and its neighbours.
#include "renderer/schedule/adaptive.h"

#include <numeric>

#include "renderer/base/tiles.h"

namespace heliograph {

std::vector<u32> noisy_tiles(const std::vector<float>& noise, u32 across, double target) {
  if (target == 0)
    target = std::accumulate(noise.begin(), noise.end(), 0.0) / double(noise.size()) / 2;
  std::vector<bool> wanted(noise.size());
  for (u32 i = 0; i < noise.size(); ++i)
    if (noise[i] > target)
      for_each_near({across, u32(noise.size())}, i, [&](u32 near) { wanted[near] = true; });
  std::vector<u32> tiles;
  for (u32 i = 0; i < noise.size(); ++i)
    if (wanted[i]) tiles.push_back(i);
  return tiles;
}

}  // namespace heliograph
