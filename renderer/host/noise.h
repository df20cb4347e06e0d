// The noise of a film, from the statistics of its pixels. Called by films.
#pragma once

#include <span>

#include "kernels/scene/film.h"
#include "renderer/resident/scene.h"

namespace heliograph::host {

struct NoiseTask {
  const kernels::FilmView& film;
  std::span<const kernels::PixelStatistics> pixels;  // noise_statistics() of each
  std::span<const u32> tile_samples;                 // at least 2
};

/// The mean relative standard error of the pixels, over the image and over each tile, in row-major
/// order. A pixel that meets nothing has none.
///
/// Where few samples have lit a pixel, or none, it is not known: its own numbers show that it has
/// no error, or that it alone has one. There the variance is shared, over squares of 2, 4, 8, ...
/// pixels, each of which gives away the more the more hits of such strength it has, so that pixels
/// of one square have the same relative error of it; so is the light, among those that are not
/// known. What even the whole image has too few hits for stays with the pixels that were hit, and
/// stands for those that none has. Errors are over at least a hundredth of the image's mean
/// luminance, so that shadows in which nothing is to be found come to an end.
[[nodiscard]] Noise noise_of(const NoiseTask& task);

}  // namespace heliograph::host
