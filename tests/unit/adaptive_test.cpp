// Adaptive sampling: which tiles it chooses, and what an adaptive frame is.
#include "renderer/schedule/adaptive.h"

#include "kernels/core/math.h"

#include "renderer/schedule/engine.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

/// Beauty, samples and variance of the still life, 96x96.
RenderJob adaptive_job(StopRule stop) {
  RenderJob job = job_of(still_life().apply(), {Plane::BEAUTY, Plane::SAMPLES, Plane::VARIANCE});
  job.width = job.height = 96;
  job.stop = stop;
  job.stop.adaptive = true;
  return job;
}

double sum_of(std::span<const u32> values) {
  double sum = 0;
  for (const u32 value : values) sum += value;
  return sum;
}

}  // namespace

TEST_CASE("adaptive: tiles above the target and their neighbours") {
  std::vector<float> noise(20, 0.1f);  // 5 across
  CHECK(noisy_tiles(noise, 5, 0.15).empty());
  noise[0] = 0.2f;
  CHECK(noisy_tiles(noise, 5, 0.15) == std::vector<u32>{0, 1, 5, 6});
  noise[0] = 0.1f;
  noise[13] = 0.2f;
  CHECK(noisy_tiles(noise, 5, 0.15) == std::vector<u32>{7, 8, 9, 12, 13, 14, 17, 18, 19});
}

TEST_CASE("adaptive: without a target, above half the mean") {
  // The mean is 0.16: only the last tile and its neighbours are above 0.08.
  CHECK(noisy_tiles({0.05f, 0.05f, 0.05f, 0.05f, 0.6f}, 5, 0) == std::vector<u32>{3, 4});
  CHECK(noisy_tiles({0, 0, 0}, 3, 0).empty());
}

TEST_CASE("adaptive: every tile reaches the noise asked for, at fewer samples than evenly") {
  auto engine = make_engine();
  StopRule stop;
  stop.noise = 0.04;
  stop.spp = 4096;
  const auto frame = render(*engine, adaptive_job(stop));
  CHECK(frame->noise < 0.04);
  const auto samples = pixels<u32>(*frame, 1);
  const auto [least, most] = std::ranges::minmax(samples);
  CHECK(least >= 16);
  CHECK(most == frame->samples);
  CHECK(least < most);
  CHECK(sum_of(samples) == 16 * (double(samples.size()) + 256 * double(frame->tile_rounds)));

  RenderJob even = adaptive_job(stop);
  even.stop = {.spp = most};
  const auto reference = render(*engine, even);
  // The means agree within four standard errors of the adaptive one, tile by tile.
  const auto a = pixels<float>(*frame, 0), b = pixels<float>(*reference, 0);
  const auto variance = pixels<float>(*frame, 2);
  double difference = 0, spread = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    difference += kernels::luminance(vec3(a[4 * i], a[4 * i + 1], a[4 * i + 2])) -
                  kernels::luminance(vec3(b[4 * i], b[4 * i + 1], b[4 * i + 2]));
    spread += double(variance[i]);
  }
  CHECK(std::abs(difference) < 4 * std::sqrt(spread));
}

TEST_CASE("adaptive: spp bounds every pixel") {
  auto engine = make_engine();
  StopRule stop;
  stop.noise = 1e-5;
  stop.spp = 40;
  const auto frame = render(*engine, adaptive_job(stop));
  CHECK(std::ranges::max(pixels<u32>(*frame, 1)) == 40);
  CHECK(frame->samples == 40);
}

TEST_CASE("adaptive: a number of rounds renders the same bytes again") {
  auto engine = make_engine();
  StopRule stop{.seconds = 1};
  auto timed = render(*engine, adaptive_job(stop));
  for (; timed->tile_rounds == 0; stop.seconds *= 2)  // a loaded machine leaves no time for rounds
    timed = render(*engine, adaptive_job(stop));
  const auto again = render(*engine, adaptive_job({.tile_rounds = timed->tile_rounds}));
  CHECK(again->planes[0].pixels == timed->planes[0].pixels);
  CHECK(again->planes[1].pixels == timed->planes[1].pixels);
}
