// Tiles of a picture and those beside them. Called by the noise of a film and the choice of tiles.
#pragma once

#include <algorithm>

#include "renderer/base/types.h"

namespace heliograph {

/// Tiles in row-major order.
struct TileGrid {
  u32 across;
  u32 count;
};

/// f(j) of a tile and of its up to eight neighbours, ascending.
template <class F>
void for_each_near(const TileGrid& grid, u32 tile, F&& f) {
  const u32 x = tile % grid.across, y = tile / grid.across, down = grid.count / grid.across;
  for (u32 v = y - std::min(y, 1u); v <= std::min(y + 1, down - 1); ++v)
    for (u32 u = x - std::min(x, 1u); u <= std::min(x + 1, grid.across - 1); ++u)
      f(v * grid.across + u);
}

}  // namespace heliograph
