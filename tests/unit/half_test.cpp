// Half floats against their definition.
#include "renderer/base/half.h"

#include <cmath>
#include <limits>
#include <random>

#include "tests/unit/catch.h"

using namespace heliograph;

TEST_CASE("half: every half comes back from its float") {
  for (u32 half = 0; half < 0x10000; ++half) {
    const float value = float_of_half(u16(half));
    if (std::isnan(value))
      CHECK((half_of_float(value) & 0x7fffu) == 0x7e00u);
    else
      REQUIRE(half_of_float(value) == half);
  }
}

TEST_CASE("half: floats go to the nearest, a tie to the even one") {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> exponent(-26, 17), mantissa(-2, 2);
  for (int i = 0; i < 1'000'000; ++i) {
    float x = std::ldexp(mantissa(random), int(exponent(random)));
    const u16 half = half_of_float(x);
    x = std::clamp(x, -65504.0f, 65504.0f);
    const double error = std::fabs(double(float_of_half(half)) - x);
    const bool is_normal = std::fabs(x) >= 0x1p-14f;
    REQUIRE(error <= (is_normal ? std::fabs(x) * 0x1p-11 : 0x1p-25));
    for (const int step : {-1, 1}) {
      const float other = float_of_half(u16(half + step));
      if (!std::isfinite(other)) continue;
      const double its = std::fabs(double(other) - x);
      REQUIRE((error < its || (error == its && half % 2 == 0)));
    }
  }
}

TEST_CASE("half: what is finite stays so, what is not stays so too") {
  CHECK(half_of_float(65519.0f) == 0x7bff);
  CHECK(half_of_float(-3e38f) == 0xfbff);
  CHECK(half_of_float(std::numeric_limits<float>::infinity()) == 0x7c00);
  CHECK(half_of_float(-std::numeric_limits<float>::infinity()) == 0xfc00);
  CHECK(half_of_float(-0.0f) == 0x8000);
}
