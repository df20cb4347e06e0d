#include "renderer/host/noise.h"

#include <algorithm>
#include <cmath>

#include "renderer/base/tiles.h"

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
  [[nodiscard]] double mean() const { return light / double(pixels); }
  /// That of one with the mean number of hits, over no less than `floor`.
  [[nodiscard]] double error(double floor) const {
    if (!(hits > 0)) return 0;
    return std::sqrt(double(pixels) / hits) * mean() / std::max(mean(), floor);
  }
  /// The variances of such pixels, summed up.
  [[nodiscard]] double variances() const { return light * light / hits; }
};

/// So many tell of all.
constexpr double kEnoughHits = 4;

Dim of(const TileNoise& tile) {
  Dim dim;
  dim.add(tile);
  return dim;
}
Dim around(std::span<const TileNoise> tiles, u32 across, u32 index) {
  Dim dim;
  for_each_near({across, u32(tiles.size())}, index, [&](u32 near) { dim.add(tiles[near]); });
  return dim;
}

/// What tiles that few samples have lit are judged by.
struct Picture {
  const kernels::FilmView& film;
  Dim dim;           // of all tiles
  double floor = 0;  // of luminance
  [[nodiscard]] double pixels_of(u32 tile) const {
    const kernels::PixelRect rect = kernels::tile_rect(film, tile);
    return double((rect.x1 - rect.x0) * (rect.y1 - rect.y0));
  }
};

/// The same if the dim pixels are like the others, but for what happened to hit them: then they are
/// brighter, and the variance of each is the mean over the tile. 0: they are not.
double errors_if_alike(const TileNoise& tile, double pixels, double floor) {
  const Dim dim = of(tile);
  const double known = pixels - double(dim.pixels);
  if (!(dim.hits > 0 && known > 0)) return 0;
  const double light = (tile.light - dim.light) / known;
  if (dim.mean() <= light) return 0;
  const double variances = known * std::pow(tile.errors / known * light, 2) + dim.variances();
  return pixels * std::sqrt(variances / pixels) / std::max(tile.light / pixels, floor);
}

/// The errors of a tile's pixels, summed up. Whether light that few samples brought may hit all of
/// them or those alone that it has hit the samples do not tell: the more there are, the more does
/// the first count.
double errors_of(std::span<const TileNoise> tiles, u32 index, const Picture& picture) {
  const TileNoise& tile = tiles[index];
  if (tile.dim == 0) return tile.errors;
  Dim dim = of(tile);
  if (dim.hits < kEnoughHits) dim = around(tiles, kernels::tiles_across(picture.film), index);
  const double apart =
      tile.errors + tile.dim * (dim.hits > 0 ? dim : picture.dim).error(picture.floor);
  const double alike = errors_if_alike(tile, picture.pixels_of(index), picture.floor);
  if (!(alike > apart)) return apart;
  return apart * std::pow(alike / apart, tile.dim_hits / (tile.dim_hits + kEnoughHits));
}

}  // namespace

Noise noise_of(std::span<const TileNoise> tiles, const kernels::FilmView& film) {
  constexpr double kFloor = 0.01;
  const double pixels = double(film.width) * film.height;
  Picture picture{.film = film, .dim = {}};
  for (const TileNoise& tile : tiles) {
    picture.floor += kFloor * tile.light / pixels;
    picture.dim.add(tile);
  }
  Noise noise{.mean = 0};
  for (u32 i = 0; i < tiles.size(); ++i) {
    const double errors = errors_of(tiles, i, picture);
    noise.mean += errors / pixels;
    noise.tiles.push_back(float(errors / picture.pixels_of(i)));
  }
  return noise;
}

}  // namespace heliograph::host
