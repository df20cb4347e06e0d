#include "renderer/host/noise.h"

#include <algorithm>
#include <cmath>

namespace heliograph::host {
namespace {

using kernels::TileNoise;

struct Dim {
  double light = 0, hits = 0;  // sums
  u64 pixels = 0;

  void add(const TileNoise& tile) {
    light += tile.dim_light;
    hits += tile.dim_hits;
    pixels += tile.dim;
  }
  /// That of one with the mean number of hits, over no less than `floor`.
  [[nodiscard]] double error(double floor) const {
    if (!(hits > 0)) return 0;
    const double mean = light / double(pixels);
    return std::sqrt(double(pixels) / hits) * mean / std::max(mean, floor);
  }
};

/// So many tell of all.
constexpr double kEnoughHits = 4;

Dim of(const TileNoise& tile) {
  Dim dim;
  dim.add(tile);
  return dim;
}
Dim around(std::span<const TileNoise> tiles, u32 across, u32 index) {
  const u32 down = u32(tiles.size()) / across;
  const u32 x = index % across, y = index / across;
  Dim dim;
  for (u32 v = y - std::min(y, 1u); v <= std::min(y + 1, down - 1); ++v)
    for (u32 u = x - std::min(x, 1u); u <= std::min(x + 1, across - 1); ++u)
      dim.add(tiles[v * across + u]);
  return dim;
}

}  // namespace

Noise noise_of(std::span<const TileNoise> tiles, const kernels::FilmView& film) {
  const double pixels = double(film.width) * film.height;
  double light = 0;
  Dim all;
  for (const TileNoise& tile : tiles) {
    light += tile.light;
    all.add(tile);
  }
  constexpr double kFloor = 0.01;
  const double floor = kFloor * light / pixels;
  Noise noise{.mean = 0};
  for (u32 i = 0; i < tiles.size(); ++i) {
    double errors = tiles[i].errors;
    if (tiles[i].dim > 0) {
      Dim known = of(tiles[i]);
      if (known.hits < kEnoughHits) known = around(tiles, kernels::tiles_across(film), i);
      errors += tiles[i].dim * (known.hits > 0 ? known : all).error(floor);
    }
    noise.mean += errors / pixels;
    const kernels::PixelRect rect = kernels::tile_rect(film, i);
    noise.tiles.push_back(float(errors / double((rect.x1 - rect.x0) * (rect.y1 - rect.y0))));
  }
  return noise;
}

}  // namespace heliograph::host
