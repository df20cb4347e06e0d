// An accumulating image as a device sees it, and what its sums mean. Written by path.h and probe.h,
// read by a backend's resolve().
#pragma once

#include "kernels/math.h"
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

namespace heliograph::kernels::inline HELIO_ISA {

KERNEL bool wants(const FilmView& film, Plane plane) { return film.wanted & plane_bit(plane); }

/// Adds a sample's value to a pixel's sums. `whole`: it is the last one of its block.
KERNEL void add_to_sum(float& sum, float& partial, float value, bool whole) {
  partial += value;
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

/// A channel of a mean plane after `samples` samples. i: pixel * channels + channel.
KERNEL float mean_value(const FilmView& film, Plane plane, u64 i, u32 samples) {
  const float* sum = static_cast<const float*>(film.planes[u32(plane)]);
  return (sum[i] + film.partial[u32(plane)][i]) / float(samples);
}

/// Luminance of a pixel's beauty after `samples` samples, and the variance of that mean (infinite
/// below two samples).
struct PixelStatistics {
  float mean;
  float variance;
};
KERNEL PixelStatistics pixel_statistics(const FilmView& film, u64 pixel, u32 samples) {
  const vec3 beauty(mean_value(film, Plane::BEAUTY, 4 * pixel, samples),
                    mean_value(film, Plane::BEAUTY, 4 * pixel + 1, samples),
                    mean_value(film, Plane::BEAUTY, 4 * pixel + 2, samples));
  const float mean = luminance(beauty);
  if (samples < 2) return {mean, INFINITY};
  const float moment = (film.moment[pixel] + film.moment_partial[pixel]) / float(samples);
  return {mean, max2(moment - mean * mean, 0.0f) / float(samples - 1)};
}

/// Standard error of a pixel's mean luminance over that luminance; 0 where it is black.
KERNEL float relative_error(const FilmView& film, u64 pixel, u32 samples) {
  const PixelStatistics s = pixel_statistics(film, pixel, samples);
  return s.mean > 0 ? std::sqrt(s.variance) / s.mean : 0;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
