#include "renderer/host/noise.h"

#include <algorithm>
#include <cmath>

#include "renderer/base/parallel.h"
#include "renderer/host/noise_tree.h"

namespace heliograph::host {
namespace {

using kernels::PixelStatistics;

/// Number of samples that would make a pixel's light, each with the same and all others nothing.
double hits_of_light(const PixelStatistics& s, u32 samples) {
  const double square = double(s.mean) * s.mean;
  return square * samples / (square + double(s.variance) * (samples - 1));
}

class Picture {
 public:
  explicit Picture(const NoiseTask& task) : task_(task) {
    double light = 0;
    u64 meeting = 0;
    for (const PixelStatistics& s : task.pixels) {
      if (!meets(s)) continue;
      light += s.mean;
      ++meeting;
    }
    mean_ = meeting > 0 ? light / double(meeting) : 0;
    constexpr double kFloor = 0.01;
    floor_ = kFloor * light / double(task.pixels.size());
  }

  [[nodiscard]] bool is_black() const { return !(mean_ > 0); }
  [[nodiscard]] kernels::PixelRect rect(u32 tile) const {
    return kernels::tile_rect(task_.film, tile);
  }

  /// The tree over a tile's pixels.
  [[nodiscard]] NoiseTree tree(u32 tile) const {
    const kernels::PixelRect r = rect(tile);
    NoiseTree tree(r.x1 - r.x0, r.y1 - r.y0);
    for (u32 y = r.y0; y < r.y1; ++y)
      for (u32 x = r.x0; x < r.x1; ++x)
        tree.leaf(x - r.x0, y - r.y0) = cell_of(at(x, y), task_.tile_samples[tile]);
    tree.gather();
    return tree;
  }

  /// The errors of a tile's pixels, summed up. above: what the image's tree gives to each of them,
  /// left: what it has not shared, for those that no sample has lit.
  [[nodiscard]] double errors(u32 tile, bool all_known, const NoiseShare& above,
                              const NoiseShare& left) const {
    const kernels::PixelRect r = rect(tile);
    double sum = 0;
    if (all_known) {  // no cell of the tile has anything to share
      for (u32 y = r.y0; y < r.y1; ++y)
        for (u32 x = r.x0; x < r.x1; ++x)
          sum += error(at(x, y), task_.tile_samples[tile], above, left);
      return sum;
    }
    NoiseTree pixels = tree(tile);
    pixels.share(above);
    for (u32 y = r.y0; y < r.y1; ++y)
      for (u32 x = r.x0; x < r.x1; ++x)
        sum += error(at(x, y), task_.tile_samples[tile], pixels.share_of(x - r.x0, y - r.y0), left);
    return sum;
  }

 private:
  static bool meets(const PixelStatistics& s) { return s.mean >= 0; }
  [[nodiscard]] const PixelStatistics& at(u32 x, u32 y) const {
    return task_.pixels[u64(y) * task_.film.width + x];
  }
  static bool knows_light(const PixelStatistics& s, u32 samples) {
    return s.mean > 0 && (!(s.variance > 0) || hits_of_light(s, samples) >= kKnownFrom);
  }
  static bool knows_variance(const PixelStatistics& s) {
    return !(s.variance > 0) || s.hits >= kKnownFrom;
  }
  /// How much of what is shared a pixel gets: between as its light, as where each sample has the
  /// same chance to be hit, and as its square, which would be the same relative error for all.
  [[nodiscard]] double weight_of(double light) const { return light * std::sqrt(light * mean_); }

  [[nodiscard]] NoiseCell cell_of(const PixelStatistics& s, u32 samples) const {
    if (!meets(s)) return {};
    NoiseCell cell{.variance = s.variance};
    if (s.variance > 0) cell.spread = cell.variance * cell.variance / s.hits;
    const bool knows = knows_light(s, samples);
    cell.weight = weight_of(knows ? s.mean : mean_);
    cell.known = knows && knows_variance(s);
    if (!cell.known) cell.pending_variance = s.variance;
    if (!knows) {
      cell.dark = 1;
      cell.pending_light = s.mean;
    }
    return cell;
  }

  [[nodiscard]] double error(const PixelStatistics& s, u32 samples, const NoiseShare& share,
                             const NoiseShare& left) const {
    if (!meets(s)) return 0;
    const bool lit = s.mean > 0, knows = knows_light(s, samples);
    double light = s.mean;
    if (!knows) light = share.light + (lit ? share.own * s.mean : left.light);
    const double own = knows && knows_variance(s) ? 1 : share.own;
    const double shared = share.variance + (lit ? 0 : left.variance);
    const double variance = own * s.variance + shared * weight_of(knows ? s.mean : mean_);
    return std::sqrt(variance) / std::max(light, floor_);
  }

  const NoiseTask& task_;
  double mean_;   // luminance of what meets something
  double floor_;  // that errors are over
};

}  // namespace

Noise noise_of(const NoiseTask& task) {
  const u32 across = kernels::tiles_across(task.film), tiles = kernels::tiles_of(task.film);
  const Picture picture(task);
  if (picture.is_black()) return {.mean = 0, .tiles = std::vector<float>(tiles)};

  NoiseTree tree(across, tiles / across);
  parallel_for(tiles, [&](u32 i) { tree.leaf(i % across, i / across) = picture.tree(i).root(); });
  tree.gather();
  tree.share({});
  const NoiseCell& all = tree.root();
  NoiseShare left;
  if (all.dark > 0)
    left = {.variance = all.pending_variance / all.weight, .light = all.pending_light / all.dark};

  std::vector<double> errors(tiles);
  parallel_for(tiles, [&](u32 i) {
    const u32 x = i % across, y = i / across;
    errors[i] = picture.errors(i, tree.leaf(x, y).known, tree.share_of(x, y), left);
  });
  Noise noise{.mean = 0};
  for (u32 i = 0; i < tiles; ++i) {
    const kernels::PixelRect rect = picture.rect(i);
    noise.mean += errors[i] / double(task.pixels.size());
    noise.tiles.push_back(float(errors[i] / double((rect.x1 - rect.x0) * (rect.y1 - rect.y0))));
  }
  return noise;
}

}  // namespace heliograph::host
