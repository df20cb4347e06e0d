// The sampler: every pair of dimensions is a (0, 2)-sequence in base 2, and pairs are independent.
#include "kernels/core/sampler.h"

#include <set>

#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"

using namespace heliograph::kernels;
using namespace heliograph::test;

TEST_CASE("sampler: each aligned block of 2^m samples is a (0, m, 2)-net") {
  for (u32 pair : {0u, 1u, 7u, 1000u}) {
    for (u32 first : {0u, 64u, 192u, 1u << 20}) {
      for (u32 log_x = 0; log_x <= 6; ++log_x) {
        std::set<u32> cells;
        for (u32 i = first; i < first + 64; ++i) {
          const vec2 p = Sampler(pixel_key(3, 5, pair), i).get2(pair);
          const u32 x = u32(p.x * float(1 << log_x));
          const u32 y = u32(p.y * float(1 << (6 - log_x)));
          cells.insert(x << 16 | y);
        }
        CHECK(cells.size() == 64);
      }
    }
  }
}

TEST_CASE("sampler: the first of a pair alone is the same number") {
  for (u32 i = 0; i < 100; ++i) {
    const Sampler s(pixel_key(1, 2, 3), i);
    CHECK(s.get1(9) == s.get2(9).x);
  }
}

TEST_CASE("sampler: pairs that are drawn side by side are the same numbers") {
  SamplerLanes lanes;
  DrawnPairs drawn[kLanes];
  for (u32 i = 0; i < kLanes; ++i) {
    lanes.pixel_key[i] = pixel_key(7, i, 3 * i);
    lanes.sample[i] = 1000 * i;
    lanes.first[i] = 1 + 4 * i;
    lanes.to[i] = &drawn[i];
  }
  for (u32 count : {1u, DrawnPairs::kMost}) {
    draw(lanes, count);
    for (u32 i = 0; i < kLanes; ++i) {
      const Sampler alone(lanes.pixel_key[i], lanes.sample[i]);
      const Sampler sampler(lanes.pixel_key[i], lanes.sample[i], &drawn[i]);
      for (u32 k = 0; k < count; ++k) CHECK(drawn[i].of[k] == alone.get2(lanes.first[i] + k));
      for (u32 pair = lanes.first[i] - 1; pair <= lanes.first[i] + DrawnPairs::kMost; ++pair) {
        CHECK(sampler.get2(pair) == alone.get2(pair));
        CHECK(sampler.get1(pair) == alone.get1(pair));
      }
    }
  }
}

TEST_CASE("sampler: over pixels numbers are uniform and pairs independent (chi-squared, 1e-6)") {
  for (u32 sample : {0u, 1u, 5u, 300u}) {
    u32 pixel = 0;
    const auto in_one_pair = [&](double& x, double& y) {
      const vec2 p = Sampler(pixel_key(0, pixel % 317, pixel / 317), sample).get2(2);
      ++pixel;
      x = p.x, y = p.y;
      return true;
    };
    CHECK(square_p_value({}, in_one_pair, [](double, double) { return 1; }) > kLevel);
    pixel = 0;
    const auto in_two_pairs = [&](double& x, double& y) {
      const Sampler s(pixel_key(0, pixel % 317, pixel / 317), sample);
      ++pixel;
      x = s.get2(2).x, y = s.get2(3).x;
      return true;
    };
    CHECK(square_p_value({}, in_two_pairs, [](double, double) { return 1; }) > kLevel);
    pixel = 0;
    const auto neighbours = [&](double& x, double& y) {
      x = Sampler(pixel_key(0, pixel, 0), sample).get1(4);
      y = Sampler(pixel_key(0, pixel + 1, 0), sample).get1(4);
      pixel += 2;
      return true;
    };
    CHECK(square_p_value({}, neighbours, [](double, double) { return 1; }) > kLevel);
  }
}

TEST_CASE("sampler: within a pixel pairs of pairs are independent (chi-squared, 1e-6)") {
  u32 sample = 0;
  const auto two = [&](double& x, double& y) {
    const Sampler s(pixel_key(11, 3, 4), sample++);
    x = s.get2(1).x, y = s.get2(2).y;
    return true;
  };
  CHECK(square_p_value({}, two, [](double, double) { return 1; }) > kLevel);
  std::vector<double> counts(256), expected(256, 400);
  for (u32 i = 0; i < 256 * 400; ++i) ++counts[Sampler(pixel_key(1, 1, 1), i).hash_of(2) >> 24];
  CHECK(chi2_p_value(counts, expected) > kLevel);
}

TEST_CASE("sampler: the mean of a smooth function converges faster than at random") {
  double worst = 0;
  for (u32 pixel = 0; pixel < 100; ++pixel) {
    double sum = 0;
    for (u32 i = 0; i < 256; ++i) {
      const vec2 p = Sampler(pixel_key(9, pixel, 0), i).get2(3);
      sum += std::sin(3 * p.x) * p.y;
    }
    const double exact = (1 - std::cos(3.0)) / 3 / 2;
    worst = std::max(worst, std::fabs(sum / 256 - exact));
  }
  CHECK(worst < 0.004);  // a random estimate has a standard error of 0.02
}
