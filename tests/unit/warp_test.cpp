// Warps and pixel filters against their densities; trigonometry against the library.
#include "kernels/core/warp.h"

#include "kernels/camera/filter.h"
#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"
#include "tests/unit/random.h"

using namespace heliograph::kernels;
using namespace heliograph::test;

TEST_CASE("math: sine, cosine and arc tangent") {
  for (int i = -20000; i <= 20000; ++i) {
    const float turns = float(i) * 1.37e-4f;
    const SinCos s = sincos_turns(turns);
    REQUIRE(std::fabs(s.sin - std::sin(2 * M_PI * double(turns))) < 2e-7);
    REQUIRE(std::fabs(s.cos - std::cos(2 * M_PI * double(turns))) < 2e-7);
    const double angle = 2 * M_PI * double(turns);
    const float y = float(3 * std::sin(angle));
    const float x = float(3 * std::cos(angle));
    REQUIRE(std::fabs(atan2_turns(y, x) - std::atan2(double(y), double(x)) / (2 * M_PI)) < 1e-7);
  }
  CHECK(atan2_turns(0.0f, 0.0f) == 0);
  CHECK(atan2_turns(0.0f, -1.0f) == 0.5f);
}

TEST_CASE("math: frames are orthonormal and right-handed") {
  Random random;
  for (int i = 0; i < 1000; ++i) {
    const Frame f = make_frame(sample_sphere(random.next2()));
    CHECK(std::fabs(dot(f.s, f.t)) < 1e-6f);
    CHECK(length(cross(f.s, f.t) - f.n) < 1e-6f);
  }
}

TEST_CASE("warp: chi-squared of every map, level 1e-6") {
  Random random;
  SECTION("disk, in polar coordinates") {
    const auto sample = [&](double& x, double& y) {
      const vec2 d = sample_disk(random.next2());
      x = double(d.x) * d.x + double(d.y) * d.y;
      y = std::atan2(double(d.y), double(d.x)) / (2 * M_PI) + 0.5;
      return true;
    };
    CHECK(square_p_value({}, sample, [](double, double) { return 1; }) > kLevel);
  }
  SECTION("cosine hemisphere, in z and azimuth") {
    const auto sample = [&](double& x, double& y) {
      const vec3 d = sample_cosine(random.next2());
      x = d.z;
      y = std::atan2(double(d.y), double(d.x)) / (2 * M_PI) + 0.5;
      return true;
    };
    CHECK(square_p_value({}, sample, [](double z, double) { return 2 * z; }) > kLevel);
  }
  SECTION("sphere") {
    const auto sample = [&](double& x, double& y) {
      const vec3 d = sample_sphere(random.next2());
      x = 0.5 + 0.5 * d.z;
      y = std::atan2(double(d.y), double(d.x)) / (2 * M_PI) + 0.5;
      return true;
    };
    CHECK(square_p_value({}, sample, [](double, double) { return 1; }) > kLevel);
  }
  SECTION("triangle") {
    const auto sample = [&](double& x, double& y) {
      const vec2 b = sample_triangle(random.next2());
      x = b.x, y = b.y;
      return b.x >= 0 && b.y >= 0 && b.x + b.y <= 1;
    };
    const auto density = [](double x, double y) { return x + y < 1 ? 2.0 : 0.0; };
    CHECK(square_p_value({20, 64, 100000}, sample, density) > kLevel);
  }
}

TEST_CASE("warp: a table is chosen from by its sums, and the rest is uniform") {
  const float cdf[] = {0.1f, 0.1f, 0.4f, 1};
  Random random;
  std::vector<double> counts(4 * 8), expected(4 * 8);
  const double shares[] = {0.1, 0, 0.3, 0.6};
  for (int i = 0; i < 32; ++i) expected[size_t(i)] = 100000 * shares[i / 8] / 8;
  for (int i = 0; i < 100000; ++i) {
    const Choice c = choose(cdf, 4, random.next());
    REQUIRE(c.rest < 1);
    ++counts[c.index * 8 + u32(c.rest * 8)];
  }
  CHECK(chi2_p_value(counts, expected) > kLevel);
}

TEST_CASE("filter: chi-squared of every pixel filter, level 1e-6") {
  struct Row {
    PixelFilter filter;
    double radius;
    double (*density)(double);
  };
  const Row rows[] = {
      {PixelFilter::kBox, 0.5, [](double) { return 1.0; }},
      {PixelFilter::kTent, 1, [](double x) { return 1 - std::fabs(x); }},
      {PixelFilter::kGaussian, 1.5,
       [](double x) { return std::exp(-2 * x * x) / (std::sqrt(M_PI / 2) * 0.9973002); }},
      {PixelFilter::kBlackmanHarris, 1.65, [](double x) {
         const double t = 2 * M_PI * x / 3.3;
         return (0.35875 + 0.48829 * std::cos(t) + 0.14128 * std::cos(2 * t) +
                 0.01168 * std::cos(3 * t)) /
                (0.35875 * 3.3);
       }}};
  for (const Row& row : rows) {
    INFO(int(row.filter));
    Random random;
    const auto sample = [&](double& x, double& y) {
      const vec2 d = sample_filter(row.filter, random.next2());
      x = d.x / (2 * row.radius) + 0.5;
      y = d.y / (2 * row.radius) + 0.5;
      return x >= 0 && x <= 1 && y >= 0 && y <= 1;
    };
    const auto density = [&](double x, double y) {
      const double side = 2 * row.radius;
      return row.density((x - 0.5) * side) * row.density((y - 0.5) * side) * side * side;
    };
    CHECK(square_p_value({32, 8, 200000}, sample, density) > kLevel);
  }
}
