// Pearson's chi-squared test. Included by the kernels' unit tests.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "kernels/core/platform.h"

namespace heliograph::test {

/// Regularised upper incomplete gamma function: series and continued fraction (Press et al.,
/// "Numerical Recipes", section 6.2).
inline double upper_gamma(double a, double x) {
  const double front = std::exp(-x + a * std::log(x) - std::lgamma(a));
  if (x < a + 1) {
    double term = 1 / a, sum = term;
    for (int n = 1; n < 10000 && term > sum * 1e-15; ++n) sum += term *= x / (a + n);
    return 1 - sum * front;
  }
  double b = x + 1 - a, c = 1e300, d = 1 / b, h = d;
  for (int i = 1; i < 10000; ++i) {
    const double an = -i * (i - a);
    b += 2;
    d = 1 / (an * d + b);
    c = b + an / c;
    h *= d * c;
    if (std::fabs(d * c - 1) < 1e-15) break;
  }
  return front * h;
}

/// Probability of counts at least as far from what was expected. Cells that expect fewer than 5
/// are pooled.
inline double chi2_p_value(const std::vector<double>& counts, const std::vector<double>& expected) {
  std::vector<std::size_t> order(counts.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return expected[a] < expected[b]; });
  double chi2 = 0, pooled_count = 0, pooled_expected = 0;
  int cells = 0;
  for (const std::size_t i : order) {
    pooled_count += counts[i];
    pooled_expected += expected[i];
    if (pooled_expected < 5) continue;
    chi2 += (pooled_count - pooled_expected) * (pooled_count - pooled_expected) / pooled_expected;
    pooled_count = pooled_expected = 0;
    ++cells;
  }
  if (pooled_count > 25) return 0;  // samples where next to none belong
  return cells < 2 ? 1 : upper_gamma(0.5 * (cells - 1), std::max(0.5 * chi2, 1e-12));
}

/// Places of the unit square: what `sample(i)` returns against a density. The density is integrated
/// over cells x cells cells by the midpoint rule with `steps`^2 points each.
struct SquareTest {
  int cells = 20;
  int steps = 16;
  int samples = 100000;
};
/// sample   fills two coordinates in [0, 1); false when there is no sample
/// density  over the square, may integrate to less than one
inline double square_p_value(const SquareTest& test,
                             const std::function<bool(double&, double&)>& sample,
                             const std::function<double(double, double)>& density) {
  const int n = test.cells;
  std::vector<double> counts(std::size_t(n) * n), expected(counts.size());
  double total = 0;
  for (int i = 0; i < n * test.steps; ++i) {
    for (int j = 0; j < n * test.steps; ++j) {
      const double x = (j + 0.5) / (n * test.steps), y = (i + 0.5) / (n * test.steps);
      const double mass = density(x, y) / (double(n) * n * test.steps * test.steps);
      expected[std::size_t(i / test.steps) * n + j / test.steps] += mass * test.samples;
      total += mass;
    }
  }
  for (int i = 0; i < test.samples; ++i) {
    double x = 0, y = 0;
    if (!sample(x, y)) continue;
    const int cx = std::clamp(int(x * n), 0, n - 1), cy = std::clamp(int(y * n), 0, n - 1);
    ++counts[std::size_t(cy) * n + cx];
  }
  // Whatever is missing is a cell of its own: samples that failed.
  double seen = 0;
  for (const double c : counts) seen += c;
  counts.push_back(test.samples - seen);
  expected.push_back(std::max(0.0, test.samples * (1 - total)));
  return chi2_p_value(counts, expected);
}

/// The unit square to unit directions and back, preserving area (up to 4 pi).
inline kernels::vec3 from_square(double x, double y) {
  const double z = 2 * y - 1, r = std::sqrt(1 - z * z);
  return {r * std::cos(2 * M_PI * x), r * std::sin(2 * M_PI * x), z};
}
inline void to_square(kernels::vec3 d, double& x, double& y) {
  x = std::atan2(double(d.y), double(d.x)) / (2 * M_PI);
  if (x < 0) x += 1;
  y = 0.5 + 0.5 * double(d.z);
}

/// The level of each statistical test here; a suite of a hundred of them fails by chance once in
/// ten thousand seeds, and the seeds are fixed.
inline constexpr double kLevel = 1e-6;

}  // namespace heliograph::test
