// An accumulating image as a device sees it, and what its sums mean. Written by path.h and probe.h,
// read by a backend's resolve().
#pragma once

#include "kernels/core/finite.h"
#include "kernels/core/math.h"
#include "kernels/scene/planes.h"

namespace heliograph::kernels {

/// Samples a block: a pixel's samples are summed in blocks of this many, and the blocks in order,
/// so that the sum does not depend on who traced which block.
inline constexpr u32 kBlock = 16;

/// The side of a tile of pixels. Tiles are in row-major order; the last of a row or column are cut.
inline constexpr u32 kTileSide = 16;
inline constexpr u32 kTilePixels = kTileSide * kTileSide;
// Pixels whose camera rays a CPU traces together, sample by sample: the same ones however a picture
// is cut into work, as a tracer may answer one of some million rays otherwise in other company.
inline constexpr u32 kPatchWidth = 4, kPatchHeight = 2;
inline constexpr u32 kPatchPixels = kPatchWidth * kPatchHeight;
static_assert(kTileSide % kPatchWidth == 0 && kTileSide % kPatchHeight == 0);

/// The pixels [x0, x1) x [y0, y1).
struct PixelRect {
  u32 x0, y0, x1, y1;
};

/// Where a film's pixels lie: one typed, row-major array a plane; null for planes not wanted.
/// Memory is zero at the start.
struct FilmView {
  void* planes[kPlanes];    // centre planes: the values. mean planes: float sums of whole blocks
  float* partial[kPlanes];  // mean planes: sum of the samples of the unfinished block
  // BEAUTY_GROUP has the pixels of one group after those of the other.
  const u32* rank_of_group;  // by light group of the scene: which of them, kNone: not wanted
  u32 groups;                // how many are wanted
  float* moments;            // (2) of each pixel: the same two for the square and the fourth power
  float* moments_partial;    // of beauty's luminance; null unless VARIANCE or a noise stop rule is
                             // wanted (then BEAUTY and COVERAGE are)
  float* catcher;            // (2) of each pixel: light on shadow catchers, with other entities and
  float* catcher_partial;    // without; null unless SHADOW_CATCHER is wanted
  PlaneSet wanted;
  u32 width;
  u32 height;
};

}  // namespace heliograph::kernels

namespace heliograph::kernels::inline HELIO_ISA {

KERNEL bool wants(const FilmView& film, Plane plane) { return film.wanted & plane_bit(plane); }

/// Writes a number, or a vector, to a pixel's N channels of type T.
template <int N, class T, class Value>
KERNEL void put_value(T* to, u64 pixel, const Value& value) {
  to += pixel * N;
  if constexpr (N == 1) {
    *to = T(value);
  } else {
    for (int i = 0; i < N; ++i) to[i] = value[i];
  }
}

/// Adds a sample's value to a pixel's sums; what no f32 can hold counts as 0. `whole`: it is the
/// last one of its block.
KERNEL void add_to_sum(float& sum, float& partial, float value, bool whole) {
  partial += is_finite(value) ? value : 0;
  if (whole) {
    sum += partial;
    partial = 0;
  }
}
template <int N>
KERNEL void add_sample(const FilmView& film, Plane plane, u64 pixel, const float* value,
                       bool whole) {
  float* sum = static_cast<float*>(film.planes[u32(plane)]) + pixel * N;
  float* partial = film.partial[u32(plane)] + pixel * N;
  for (int i = 0; i < N; ++i) add_to_sum(sum[i], partial[i], value[i], whole);
}

/// Adds a contribution to the unfinished block of its light group, where that is wanted.
HELIO_GPU_NOINLINE KERNEL void add_to_group(const FilmView& film, u32 group, u64 pixel,
                                            vec3 radiance) {
  const u32 rank = film.rank_of_group[group];
  if (rank == kNone) return;
  float* partial = film.partial[u32(Plane::BEAUTY_GROUP)];
  partial += (u64(rank) * film.width * film.height + pixel) * 3;
  for (int i = 0; i < 3; ++i) partial[i] += radiance[i];
}
/// Ends a block of a pixel's samples.
KERNEL void end_group_block(const FilmView& film, u64 pixel) {
  const u64 stride = u64(film.width) * film.height * 3;
  float* sum = static_cast<float*>(film.planes[u32(Plane::BEAUTY_GROUP)]) + pixel * 3;
  float* partial = film.partial[u32(Plane::BEAUTY_GROUP)] + pixel * 3;
  for (u32 group = 0; group < film.groups; ++group, sum += stride, partial += stride) {
    for (int i = 0; i < 3; ++i) add_to_sum(sum[i], partial[i], 0, true);
  }
}

/// A channel of a mean plane after `samples` samples. i: pixel * channels + channel.
KERNEL float mean_value(const FilmView& film, Plane plane, u64 i, u32 samples) {
  const float* sum = static_cast<const float*>(film.planes[u32(plane)]);
  return (sum[i] + film.partial[u32(plane)][i]) / float(samples);
}

/// Share of the light on a pixel's shadow catchers that the other entities let through.
KERNEL float catcher_share(const FilmView& film, u64 pixel) {
  const float* sum = film.catcher + pixel * 2;
  const float* partial = film.catcher_partial + pixel * 2;
  const float without = sum[1] + partial[1];
  return without > 0 ? (sum[0] + partial[0]) / without : 1;
}

/// Adds the luminance of a sample's beauty to a pixel's moments.
KERNEL void add_moments(const FilmView& film, u64 pixel, float luminance, bool whole) {
  constexpr float kLargest = 0x1p126f;  // of fourth powers: one that is too large is not lost
  const float square = sqr(luminance);
  const float powers[2] = {square, min2(sqr(square), kLargest)};
  for (u64 i = 0; i < 2; ++i) {
    const u64 at = pixel * 2 + i;
    add_to_sum(film.moments[at], film.moments_partial[at], powers[i], whole);
  }
}

/// A mean over the samples of a pixel: of the squares (i = 0) or of the fourth powers (1).
KERNEL float mean_moment(const FilmView& film, u64 pixel, u64 i, u32 samples) {
  const u64 at = pixel * 2 + i;
  return (film.moments[at] + film.moments_partial[at]) / float(samples);
}

/// Luminance of a pixel's beauty after `samples` samples, and the variance of that mean (infinite
/// below two samples).
struct PixelStatistics {
  float mean;
  float variance;
  float hits;  // samples that would amount to it, if each had the same and all others nothing
};
KERNEL PixelStatistics pixel_statistics(const FilmView& film, u64 pixel, u32 samples) {
  const vec3 beauty(mean_value(film, Plane::BEAUTY, 4 * pixel, samples),
                    mean_value(film, Plane::BEAUTY, 4 * pixel + 1, samples),
                    mean_value(film, Plane::BEAUTY, 4 * pixel + 2, samples));
  const float mean = luminance(beauty);
  if (samples < 2) return {mean, INFINITY, 1};
  const float square = mean_moment(film, pixel, 0, samples), count = float(samples);
  const float root = std::sqrt(mean_moment(film, pixel, 1, samples));
  const float hits = root > 0 ? min2(max2(count * sqr(square / root), 1.0f), count) : count;
  return {mean, max2(square - mean * mean, 0.0f) / (count - 1), hits};
}

KERNEL u32 tiles_across(const FilmView& film) { return (film.width + kTileSide - 1) / kTileSide; }
KERNEL u32 tiles_of(const FilmView& film) {
  return tiles_across(film) * ((film.height + kTileSide - 1) / kTileSide);
}
KERNEL PixelRect tile_rect(const FilmView& film, u32 tile) {
  const u32 x = tile % tiles_across(film) * kTileSide, y = tile / tiles_across(film) * kTileSide;
  return {x, y, min2(x + kTileSide, film.width), min2(y + kTileSide, film.height)};
}

/// The statistics of a pixel, for the noise of its picture; the mean is negative where it meets
/// nothing.
KERNEL PixelStatistics noise_statistics(const FilmView& film, u64 pixel, u32 samples) {
  const PixelStatistics s = pixel_statistics(film, pixel, samples);
  const bool meets = s.mean > 0 || mean_value(film, Plane::COVERAGE, pixel, samples) > 0;
  return meets ? s : PixelStatistics{-1, 0, 0};
}

/// A plane that samples made, of the folds kMean and kFilm, and the array that it goes to.
struct PlaneOut {
  Plane plane;
  u32 channels;
  u32 rank;  // of BEAUTY_GROUP: of its group
  void* to;  // row-major, float; SAMPLES: u32
};
/// Writes a pixel of a plane after `samples` samples; 0 before there are any.
KERNEL void resolve_pixel(const FilmView& film, const PlaneOut& out, u64 pixel, u32 samples) {
  if (out.plane == Plane::SAMPLES) {
    static_cast<u32*>(out.to)[pixel] = samples;
    return;
  }
  const u64 image = u64(film.width) * film.height;
  for (u32 channel = 0; channel < out.channels; ++channel) {
    const u64 i = (out.rank * image + pixel) * out.channels + channel;
    float value = 0;
    if (samples == 0)
      value = 0;
    else if (out.plane == Plane::VARIANCE)
      value = pixel_statistics(film, pixel, samples).variance;
    else if (out.plane == Plane::SHADOW_CATCHER)
      value = catcher_share(film, pixel);
    else
      value = mean_value(film, out.plane, i, samples);
    static_cast<float*>(out.to)[pixel * out.channels + channel] = value;
  }
}

}  // namespace heliograph::kernels::inline HELIO_ISA
