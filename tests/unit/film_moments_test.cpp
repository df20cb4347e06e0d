// The moments of a pixel's samples in a film.
#include "kernels/integrator/sample.h"
#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

TEST_CASE("film: hits are the samples that tell a pixel's variance, at every scale of light") {
  constexpr u32 kCount = 40;
  const auto statistics = [](u32 lit, float light) {
    const TestFilm film({1, 1}, kBeauty);
    SampleValues sample;
    static_cast<SamplePlain&>(sample) = {};
    for (u32 i = 0; i < kCount; ++i) {
      sample.radiance = vec3(i < lit ? light : 0);
      write_sample(film.view, 0, sample, (i + 1) % kBlock == 0);
    }
    return pixel_statistics(film.view, 0, kCount);
  };
  for (const float light : {1e-9f, 1e-3f, 1.0f, 1e3f, 1e8f})
    for (const u32 lit : {1u, 3u, 17u, kCount}) {
      INFO(lit << " samples of " << light);
      CHECK(statistics(lit, light).hits == Approx(lit));
    }
  CHECK(statistics(0, 1).hits == kCount);  // and a variance of 0
  CHECK(statistics(3, 1e18f).hits >= 1);   // the fourth power does not fit
  CHECK(statistics(3, 1e18f).hits <= kCount);
}
