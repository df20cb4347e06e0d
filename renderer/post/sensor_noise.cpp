#include "renderer/post/sensor_noise.h"

#include <cmath>
#include <numbers>

#include "kernels/core/hash.h"

namespace heliograph {
namespace {

/// Products of uniform numbers until they fall below exp(-mean): for small means.
///
/// Source: Knuth 1997, "The Art of Computer Programming", volume 2, section 3.4.1.
double small_poisson(SensorNoise& noise, double mean) {
  const double limit = std::exp(-mean);
  double product = noise.uniform();
  double count = 0;
  for (; product > limit; ++count) product *= noise.uniform();
  return count;
}

/// std::lgamma() writes a global, too.
double log_gamma(double x) {
  int sign = 0;
  return ::lgamma_r(x, &sign);
}

/// Source: Hoermann 1993, "The Transformed Rejection Method for Generating Poisson Random
/// Variables", algorithm PTRS, for means of at least 10.
double large_poisson(SensorNoise& noise, double mean) {
  const double b = 0.931 + 2.53 * std::sqrt(mean);
  const double a = -0.059 + 0.02483 * b;
  const double inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
  const double sure = 0.9277 - 3.6224 / (b - 2);
  for (;;) {
    const double u = noise.uniform() - 0.5, v = noise.uniform();
    const double us = 0.5 - std::abs(u);
    const double k = std::floor((2 * a / us + b) * u + mean + 0.43);
    if (us >= 0.07 && v <= sure) return k;
    if (k < 0 || (us < 0.013 && v > us)) continue;
    if (std::log(v * inverse_alpha / (a / (us * us) + b)) <=
        k * std::log(mean) - mean - log_gamma(k + 1))
      return k;
  }
}

}  // namespace

SensorNoise::SensorNoise(u64 seed, u64 pixel)
    : key_(kernels::hash64(kernels::hash64(seed) + pixel * 0x9e3779b97f4a7c15ull)) {}

double SensorNoise::uniform() {
  return (double(kernels::hash64(key_ + ++next_ * 0x9e3779b97f4a7c15ull) >> 12) + 0.5) * 0x1p-52;
}

/// Source: Box and Muller 1958, "A Note on the Generation of Random Normal Deviates".
double SensorNoise::normal() {
  const double radius = std::sqrt(-2 * std::log(uniform()));
  return radius * std::cos(2 * std::numbers::pi * uniform());
}

double SensorNoise::poisson(double mean) {
  if (!(mean > 0)) return 0;
  return mean < 10 ? small_poisson(*this, mean) : large_poisson(*this, mean);
}

}  // namespace heliograph
