// Pixel filters, sampled so that every sample has weight one. Called by path.h.
#pragma once

#include "kernels/camera/filter_table.h"
#include "kernels/core/math.h"
#include "kernels/scene/settings.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Inverse of the error function, relative error 3e-7; x in (-1, 1).
///
/// Source: Giles 2012, "Approximating the erfinv Function", GPU Computing Gems Jade Edition,
/// ch. 10.
KERNEL float inverse_erf(float x) {
  float w = -std::log((1 - x) * (1 + x));
  if (w < 5) {
    w -= 2.5f;
    float p = 2.81022636e-08f;
    p = 3.43273939e-07f + p * w;
    p = -3.5233877e-06f + p * w;
    p = -4.39150654e-06f + p * w;
    p = 0.00021858087f + p * w;
    p = -0.00125372503f + p * w;
    p = -0.00417768164f + p * w;
    p = 0.246640727f + p * w;
    return (1.50140941f + p * w) * x;
  }
  w = std::sqrt(w) - 3;
  float p = -0.000200214257f;
  p = 0.000100950558f + p * w;
  p = 0.00134934322f + p * w;
  p = -0.00367342844f + p * w;
  p = 0.00573950773f + p * w;
  p = -0.0076224613f + p * w;
  p = 0.00943887047f + p * w;
  p = 1.00167406f + p * w;
  return (2.83297682f + p * w) * x;
}

/// Distance in pixels from the pixel's centre along one axis; u uniform in [0, 1).
template <class F>
KERNEL F sample_filter(PixelFilter filter, F u) {
  switch (filter) {
    case PixelFilter::kBox:
      return u - 0.5f;
    case PixelFilter::kTent:
      return select(u < 0.5f, sqrt(2 * u) - 1, 1 - sqrt(2 - 2 * u));
    case PixelFilter::kGaussian:
      // sigma 0.5, truncated at 3 sigma: erf(3 / sqrt 2) = 0.9973002
      return 0.5f * 1.41421356f * inverse_erf((2 * u - 1) * 0.9973002f);
    case PixelFilter::kBlackmanHarris:
      break;
  }
  // 3.3 pixels wide. The root makes the inverse of the integral nearly linear in the tails.
  const F half = clamp01(2 * min2(u, 1 - u));
  const F place = sqrt(sqrt(half)) * float(kFilterIntervals);
  const IntOf<F> i = min2(to_int(place), IntOf<F>(kFilterIntervals - 1));
  const F a = gather(kInverseBlackmanHarris, i);
  const F x = 3.3f * (a + (gather(kInverseBlackmanHarris, i + 1) - a) * (place - to_float(i)));
  return select(u < 0.5f, x, -x);
}

template <class F>
KERNEL Vec2<F> sample_filter(PixelFilter filter, Vec2<F> u) {
  return Vec2<F>(sample_filter(filter, u.x), sample_filter(filter, u.y));
}

}  // namespace heliograph::kernels::inline HELIO_ISA
