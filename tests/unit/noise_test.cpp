// The noise of films: of pixels that are known, and of those that light has hardly found.
#include "renderer/host/noise.h"

#include "renderer/host/noise_tree.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using kernels::PixelStatistics;

namespace {

constexpr u32 kWidth = 40, kHeight = 32, kPixels = kWidth * kHeight, kSamples = 64;

/// Pixels of luminance 1 with a standard error that all samples tell.
std::vector<PixelStatistics> lit(float error) {
  return std::vector(kPixels, PixelStatistics{1, error * error, kSamples});
}

/// Adds a sample of luminance `light` to a pixel's statistics.
void hit(PixelStatistics& s, float light) {
  const float n = kSamples, mean = light / n;
  const float added = (light * light / n - mean * mean) / (n - 1);
  const float spread = s.variance > 0 ? s.variance * s.variance / s.hits : 0;
  s.variance += added;
  s.hits = s.variance * s.variance / (spread + added * added);
  s.mean += mean;
}

Noise noise_of(const std::vector<PixelStatistics>& pixels) {
  kernels::FilmView film{};
  film.width = kWidth;
  film.height = kHeight;
  const std::vector<u32> samples(kernels::tiles_of(film), kSamples);
  return host::noise_of({film, pixels, samples});
}

}  // namespace

TEST_CASE("noise: of known pixels it is the mean of their errors, over the picture and each tile") {
  std::vector pixels = lit(0.1f);
  for (u32 i = 0; i < kPixels; ++i)
    if (i % kWidth >= 32) pixels[i] = {9, 0, 1};
  const Noise noise = noise_of(pixels);
  REQUIRE(noise.tiles.size() == 6);
  for (u32 tile = 0; tile < 6; ++tile) CHECK(noise.tiles[tile] == Approx(tile % 3 < 2 ? 0.1 : 0));
  CHECK(noise.mean == Approx(0.1 * 32 / 40));
}

TEST_CASE("noise: a tenth of the pixels that are lit tell of all") {
  std::vector pixels = std::vector(kPixels, PixelStatistics{0, 0, 1});
  for (u32 i = 0; i < kPixels; i += 10) hit(pixels[i + i / kWidth % 7], 5);
  CHECK(noise_of(pixels).mean == Approx(std::sqrt(10)).epsilon(0.1));
}

TEST_CASE("noise: rare light that is found on known pixels is on all of them") {
  std::vector pixels = lit(0.05f);
  for (u32 i = 0; i < kPixels; i += 20) hit(pixels[i + i / kWidth % 13], 2 * kSamples);
  // Each pixel has a mean of 1, and in one picture of 20 a hit that adds 2.
  const double error = std::sqrt(0.05 * 0.05 + 4.0 / 20) / 1.1, noise = noise_of(pixels).mean;
  CHECK(noise > error / 1.5);
  CHECK(noise < error * 1.5);
}

TEST_CASE("noise: one bright hit is that of its pixel") {
  std::vector pixels = lit(0.05f);
  hit(pixels[333], 1e6f * kSamples);
  const double floor = 0.01 * (1e6 + kPixels) / kPixels;
  CHECK(noise_of(pixels).mean == Approx((kPixels * 0.05 / floor + 1) / kPixels).epsilon(0.01));
}

TEST_CASE("noise: black beside light has none, nor has what meets nothing, nor a black picture") {
  std::vector pixels = lit(0.1f);
  for (u32 i = 0; i < kPixels; ++i) {
    if (i % kWidth < 16) pixels[i] = {0, 0, 1};
    if (i % kWidth >= 32) pixels[i] = {-1, 0, 0};
  }
  const Noise noise = noise_of(pixels);
  CHECK(noise.tiles[0] == 0);
  CHECK(noise.tiles[1] == Approx(0.1));
  CHECK(noise.tiles[2] == 0);
  CHECK(noise.mean == Approx(0.1 * 16 / 40));
  CHECK(noise_of(std::vector(kPixels, PixelStatistics{0, 0, 1})).mean == 0);
  CHECK(noise_of(std::vector(kPixels, PixelStatistics{-1, 0, 0})).mean == 0);
}

TEST_CASE("noise: it does not depend on the unit of light") {
  std::vector pixels = lit(0.05f);
  for (u32 i = 0; i < kPixels; i += 37) hit(pixels[i], 100);
  const double noise = noise_of(pixels).mean;
  for (PixelStatistics& s : pixels) s = {s.mean * 1e-12f, s.variance * 1e-24f, s.hits};
  CHECK(noise_of(pixels).mean == Approx(noise).epsilon(1e-4));
}

TEST_CASE("noise tree: what is shared and what is pending are all there was") {
  host::NoiseTree tree(7, 5);
  double variance = 0, light = 0;
  for (u32 y = 0; y < 5; ++y)
    for (u32 x = 0; x < 7; ++x) {
      const double v = (x * 3 + y * 5) % 11;
      tree.leaf(x, y) = {.variance = v,
                         .spread = v * v / 2,
                         .weight = 1.0 + x,
                         .dark = 1,
                         .pending_variance = v,
                         .pending_light = double(y)};
      variance += v;
      light += y;
    }
  tree.gather();
  tree.share({});
  double given = 0, lit = 0, kept = 0;
  for (u32 y = 0; y < 5; ++y)
    for (u32 x = 0; x < 7; ++x) {
      const host::NoiseShare& share = tree.share_of(x, y);
      given += share.variance * tree.leaf(x, y).weight;
      lit += share.light;
      kept += share.own * tree.leaf(x, y).variance;
    }
  CHECK(given > 0);
  CHECK(given + kept == Approx(variance));
  CHECK(kept == Approx(tree.root().pending_variance).margin(1e-9));
  CHECK(lit + tree.root().pending_light == Approx(light));
}
