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

TEST_CASE("noise: rare light on pixels that are known may hit each of them") {
  // One pixel in a hundred has been hit, by as much light as it had.
  constexpr double kError = 0.02, kRare = 2.56;
  TileNoise hit{.light = kWide + kRare, .errors = kError * (kWide - kRare)};
  hit.dim_light = 2 * kRare;
  hit.dim_hits = kRare;
  hit.dim = u32(std::lround(kRare));
  const TileNoise narrow{.light = kNarrow, .errors = kError * kNarrow};
  const std::vector tiles = {hit, narrow, hit, narrow};
  const Noise noise = host::noise_of(tiles, film());
  // Between the error if those pixels alone may be hit, and that if all may.
  CHECK(noise.tiles[0] > 1.5 * (kError + kRare / kWide));
  CHECK(noise.tiles[0] < 0.2);
  // The more hits there are, the nearer to the second.
  TileNoise sure = hit;
  sure.dim = 128;
  sure.dim_hits = 3 * 128;
  sure.dim_light = 3 * 128;
  sure.light = 4 * 128;
  sure.errors = kError * 128;
  const double all = std::sqrt(0.5 * (std::pow(kError, 2) + 9.0 / 3)) / 2;
  CHECK(host::noise_of(std::vector(4, sure), film()).tiles[0] == Approx(all).epsilon(0.02));
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
