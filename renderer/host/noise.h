// The noise of a film, from what its tiles tell. Called by films.
#pragma once

#include <span>

#include "kernels/scene/film.h"
#include "renderer/resident/scene.h"

namespace heliograph::host {

/// The mean relative standard error of the pixels, over the image and over each tile, in row-major
/// order.
///
/// Of pixels that too few samples have lit it is that of a pixel which as many have lit as on
/// average these, in the tile, with its eight neighbours or in the image where those are black;
/// over at least a hundredth of the image's mean luminance, so that shadows in which nothing is to
/// be found come to an end. Where these are brighter than the others in the tile, the variance that
/// they have is that of all in part, of the more the more hits there are. A pixel that meets
/// nothing has none.
[[nodiscard]] Noise noise_of(std::span<const kernels::TileNoise> tiles,
                             const kernels::FilmView& film);

}  // namespace heliograph::host
