// The phase function against its integral, its mean cosine and its own samples.
#include "kernels/media/phase.h"

#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"
#include "tests/unit/random.h"

using namespace heliograph::kernels;
using namespace heliograph::test;

namespace {

constexpr float kAnisotropies[] = {-0.9f, -0.3f, 0, 1e-4f, 0.5f, 0.9f, kMostAnisotropic};

/// Probability of a smaller cosine, integrated by hand.
double cumulative(double g, double cosine) {
  if (g == 0) return 0.5 * (1 + cosine);
  return (1 - g * g) / (2 * g) * (1 / std::sqrt(1 + g * g - 2 * g * cosine) - 1 / (1 + g));
}

}  // namespace

TEST_CASE("phase: integrates to 1, with g as its mean cosine") {
  for (const float g : kAnisotropies) {
    double integral = 0, mean = 0;
    constexpr int kSteps = 200000;
    for (int i = 0; i < kSteps; ++i) {
      const double cosine = (2 * i + 1.0) / kSteps - 1;
      const double mass = 2 * M_PI * double(phase_density(g, float(cosine))) * 2 / kSteps;
      integral += mass;
      mean += mass * cosine;
    }
    INFO("g " << g);
    CHECK(integral == Approx(1).epsilon(2e-3));
    CHECK(mean == Approx(double(g)).margin(2e-3));
  }
  CHECK(phase_density(0, 0.3f) == 0.25f * kInvPi);
}

TEST_CASE("phase: chi-squared of its samples, level 1e-6") {
  Random random;
  const vec3 direction = normalize(vec3(1, -2, 0.5f));
  const Frame frame = make_frame(direction);
  for (const float g : kAnisotropies) {
    const auto sample = [&](double& x, double& y) {
      const vec3 d = to_local(frame, sample_phase(g, direction, random.next2()));
      CHECK(std::fabs(length(d) - 1) < 1e-5f);
      x = cumulative(double(g), double(d.z));
      y = std::atan2(double(d.y), double(d.x)) / (2 * M_PI) + 0.5;
      return true;
    };
    INFO("g " << g);
    CHECK(square_p_value({}, sample, [](double, double) { return 1; }) > kLevel);
  }
}
