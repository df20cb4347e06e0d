// The noise of films: of pixels that are known, and of those that light has hardly found.
#include "renderer/host/noise.h"

#include "tests/unit/catch.h"

using namespace heliograph;
using kernels::TileNoise;

namespace {

/// Two by two tiles, of which those to the right are 8 pixels wide.
kernels::FilmView film() {
  kernels::FilmView view{};
  view.width = 24;
  view.height = 32;
  return view;
}
constexpr u32 kWide = 256, kNarrow = 128;

}  // namespace

TEST_CASE("noise: of known pixels it is the mean of their errors") {
  const std::vector<TileNoise> tiles = {{.light = 9, .errors = 0.5 * kWide},
                                        {.light = 9, .errors = 0.25 * kNarrow},
                                        {.light = 9, .errors = 0},
                                        {.light = 9, .errors = kNarrow}};
  const Noise noise = host::noise_of(tiles, film());
  CHECK(noise.tiles == std::vector{0.5f, 0.25f, 0.0f, 1.0f});
  CHECK(noise.mean == Approx((0.5 * kWide + 0.25 * kNarrow + kNarrow) / (2 * kWide + 2 * kNarrow)));
}

TEST_CASE("noise: what a tenth of the pixels tell counts for the black ones beside them") {
  const TileNoise dim{.light = 50, .dim_light = 50, .dim_hits = 3, .dim = 250};
  const TileNoise black{.dim = 120};
  const Noise noise = host::noise_of(std::vector{dim, black, dim, black}, film());
  const double error = std::sqrt(740.0 / 6);
  CHECK(noise.tiles[0] == Approx(error * 250 / kWide));
  CHECK(noise.tiles[1] == Approx(error * 120 / kNarrow));
}

TEST_CASE("noise: a shadow beside light comes to an end, and what meets nothing has none") {
  const TileNoise lit{.light = 200, .errors = 0.01 * kWide};
  const TileNoise shadow{.light = 1e-4, .dim_light = 1e-4, .dim_hits = 2, .dim = kNarrow};
  const Noise noise = host::noise_of(std::vector{lit, shadow, lit, TileNoise{}}, film());
  const double floor = 0.01 * 400.0001 / (24 * 32);
  CHECK(noise.tiles[1] == Approx(std::sqrt(kNarrow / 2.0) * 1e-4 / kNarrow / floor).epsilon(1e-3));
  CHECK(noise.tiles[1] < 0.002);
  CHECK(noise.tiles[3] == 0);
  CHECK(host::noise_of(std::vector<TileNoise>(4), film()).mean == 0);
}
