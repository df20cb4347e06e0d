// An accumulating image as a device sees it.
#pragma once

#include "kernels/planes.h"

namespace heliograph::kernels {

/// Samples a block: a pixel's samples are summed in blocks of this many, and the blocks in order,
/// so that the sum does not depend on who traced which block.
inline constexpr u32 kBlock = 16;

/// Where a film's pixels lie: one typed, row-major array a plane; null for planes not wanted.
/// Memory is zero at the start.
struct FilmView {
  void* planes[kPlanes];    // centre planes: the values. mean planes: float sums of whole blocks
  float* partial[kPlanes];  // mean planes: sum of the samples of the unfinished block
  float* moment;            // the same two for the squared luminance of beauty; null unless
  float* moment_partial;    // VARIANCE or a noise stop rule is wanted (then BEAUTY is there too)
  PlaneSet wanted;
  u32 width;
  u32 height;
};

}  // namespace heliograph::kernels
