// Which tiles get more samples. Called by the runner.
#pragma once

#include <vector>

#include "renderer/base/types.h"

namespace heliograph {

/// The tiles whose noise, or that of one of their eight neighbours, is above a target, in order.
///
/// noise   mean relative standard error of each tile's pixels; tiles in row-major order
/// across  tiles in a row
/// target  0: half the mean over the tiles
[[nodiscard]] std::vector<u32> noisy_tiles(const std::vector<float>& noise, u32 across,
                                           double target);

}  // namespace heliograph
