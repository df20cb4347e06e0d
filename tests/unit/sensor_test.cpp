// Sensor models against the formulas that docs/cameras.md states. Statistical bounds are 5 standard
// deviations of the estimate: one false alarm in 1.7 million.
#include "renderer/post/sensor.h"

#include <cmath>

#include "renderer/post/sensor_noise.h"
#include "tests/unit/catch.h"

using namespace heliograph;

namespace {

constexpr u32 kWidth = 400, kHeight = 250;
constexpr u64 kPixels = u64(kWidth) * kHeight;

ImageCamera camera() {
  Camera model{.width = kWidth, .height = kHeight, .fx = 300, .fy = 300, .cx = 199.5, .cy = 124.5};
  return image_camera(model, mat4x3(1), kWidth, kHeight);
}

struct Moments {
  double mean = 0, variance = 0;
};
/// Of every `stride`th value from `first` on.
Moments moments(const std::vector<float>& values, std::size_t first = 0, std::size_t stride = 1) {
  double sum = 0, square = 0, count = 0;
  for (std::size_t i = first; i < values.size(); i += stride, ++count) {
    sum += double(values[i]);
    square += double(values[i]) * double(values[i]);
  }
  const double mean = sum / count;
  return {mean, square / count - mean * mean};
}

std::vector<float> sense(const RgbSensor& sensor, vec3 radiance, u64 seed = 1) {
  std::vector<float> beauty(4 * kPixels), out(3 * kPixels);
  for (u64 i = 0; i < kPixels; ++i)
    for (int c = 0; c < 3; ++c) beauty[4 * i + u64(c)] = radiance[c];
  const ImageCamera seen_by = camera();
  const Interrupt interrupt;
  REQUIRE(sense_rgb(sensor, {beauty.data()}, {seen_by, seed, interrupt}, out.data()));
  return out;
}

/// A surface that fills the image, facing the camera, its depth a function of the column.
template <class F>
std::vector<float> measure(const DepthSensor& sensor, const F& depth_at, float white = 1) {
  std::vector<float> depth(kPixels), distance(kPixels), normal(3 * kPixels),
      color(3 * kPixels, white);
  const ImageCamera seen_by = camera();
  const std::vector<float> rough(kPixels, 1), none(kPixels, 0);
  for (u64 i = 0; i < kPixels; ++i) {
    const u64 x = i % kWidth, y = i / kWidth;
    depth[i] = depth_at(u32(x));
    const glm::dvec2 m((double(x) - seen_by.k[2][0]) / seen_by.k[0][0],
                       (double(y) - seen_by.k[2][1]) / seen_by.k[1][1]);
    distance[i] = float(double(depth[i]) * glm::length(glm::dvec3(m, 1)));
    normal[3 * i + 2] = -1;
  }
  std::vector<float> out(kPixels);
  const Interrupt interrupt;
  REQUIRE(sense_depth(sensor,
                      {depth.data(), distance.data(), normal.data(), color.data(), rough.data(),
                       none.data(), none.data()},
                      {seen_by, 7, interrupt}, out.data()));
  return out;
}

double bound_of_mean(double variance) { return 5 * std::sqrt(variance / double(kPixels)); }
/// Of the variance of something nearly normal.
double bound_of_variance(double variance) { return 5 * variance * std::sqrt(2.0 / kPixels); }

}  // namespace

TEST_CASE("sensor noise: moments of normal and Poisson numbers, small and large") {
  constexpr int kDraws = 200000;
  for (const double mean : {0.05, 0.7, 9.5, 10.5, 80.0, 5000.0}) {
    double sum = 0, square = 0, cube = 0;
    for (int i = 0; i < kDraws; ++i) {
      SensorNoise noise(3, u64(i));
      const double k = noise.poisson(mean);
      CHECK((k >= 0 && k == std::floor(k)));
      sum += k;
      square += (k - mean) * (k - mean);
      cube += std::pow(k - mean, 3);
    }
    INFO("mean " << mean);
    CHECK(sum / kDraws == Approx(mean).margin(5 * std::sqrt(mean / kDraws)));
    // Var[(k - m)^2] = 2 m^2 + m; the third central moment is m, Var[(k - m)^3] = 15 m^3 + ...
    CHECK(square / kDraws == Approx(mean).margin(5 * std::sqrt((2 * mean * mean + mean) / kDraws)));
    const double sixth = 15 * std::pow(mean, 3) + 25 * mean * mean + mean;
    CHECK(cube / kDraws == Approx(mean).margin(5 * std::sqrt(sixth / kDraws)));
  }
  double sum = 0, square = 0;
  for (int i = 0; i < kDraws; ++i) {
    SensorNoise noise(4, u64(i));
    const double x = noise.normal();
    sum += x;
    square += x * x;
  }
  CHECK(sum / kDraws == Approx(0).margin(5 / std::sqrt(kDraws)));
  CHECK(square / kDraws == Approx(1).margin(5 * std::sqrt(2.0 / kDraws)));
}

TEST_CASE("sensor rgb: mean and variance of photon and read noise") {
  const RgbSensor sensor{.exposure = 1, .full_well = 2000, .read_noise = 6, .black_level = 0.1};
  const vec3 radiance(0.05f, 0.2f, 0.4f);
  const auto out = sense(sensor, radiance);
  for (int c = 0; c < 3; ++c) {
    const double signal = 2 * double(radiance[c]);
    const double gain = 0.9 / 2000;  // output a electron
    const double variance = gain * gain * (signal * 2000 + 36);
    const Moments seen = moments(out, std::size_t(c), 3);
    CHECK(seen.mean == Approx(0.1 + 0.9 * signal).margin(bound_of_mean(variance)));
    CHECK(seen.variance == Approx(variance).margin(bound_of_variance(variance)));
  }
  CHECK(sense(sensor, radiance) == out);
  CHECK(sense(sensor, radiance, 2) != out);
  // Neighbours and channels are independent.
  double product = 0;
  const double mean = 0.1 + 0.9 * 0.8, variance = 0.9 * 0.9 / 4e6 * (1600 + 36);
  for (u64 i = 0; i + 1 < kPixels; ++i)
    product += (double(out[3 * i + 2]) - mean) * (double(out[3 * i + 5]) - mean);
  CHECK(product / kPixels == Approx(0).margin(5 * variance / std::sqrt(double(kPixels))));
}

TEST_CASE("sensor rgb: exposure, saturation, quantisation and lens shading") {
  CHECK(moments(sense({.exposure = -2}, vec3(0.5f))).mean == Approx(0.125));
  CHECK(moments(sense({}, vec3(1.5f))).mean == 1);
  CHECK(moments(sense({}, vec3(-1))).mean == 0);
  const auto coarse = sense({.bits = 2}, vec3(0.3f, 0.1f, 0.52f));
  CHECK(coarse[0] == Approx(1.0 / 3));
  CHECK(coarse[1] == 0);
  CHECK(coarse[2] == Approx(2.0 / 3));
  const auto shaded = sense({.vignetting = 1}, vec3(1));
  const double x = 199.5 / 300, y = 124.5 / 300;
  CHECK(shaded[0] == Approx(std::pow(1 + x * x + y * y, -2)));
  CHECK(sense({.vignetting = 0.5}, vec3(1))[0] ==
        Approx(0.5 + 0.5 * std::pow(1 + x * x + y * y, -2)));
}

TEST_CASE("sensor mosaic: each photosite reads its colour, demosaicing keeps what is linear") {
  using enum RgbSensor::Pattern;
  const ImageCamera seen_by = camera();
  const Interrupt interrupt;
  const SensorContext context{seen_by, 1, interrupt};
  std::vector<float> beauty(4 * kPixels), mosaic(kPixels), rgb(3 * kPixels);
  const auto truth = [](u64 pixel, int channel) {
    const u64 row = pixel / kWidth, column = pixel % kWidth;
    const float x = float(column), y = float(row);
    return channel == 0   ? 0.1f + 0.001f * x
           : channel == 1 ? 0.9f - 0.0005f * x - 0.001f * y
                          : 0.2f + 0.002f * y;
  };
  for (u64 i = 0; i < kPixels; ++i)
    for (int c = 0; c < 3; ++c) beauty[4 * i + u64(c)] = truth(i, c);
  const std::pair<RgbSensor::Pattern, const char*> patterns[] = {
      {kRggb, "RGGB"}, {kBggr, "BGGR"}, {kGrbg, "GRBG"}, {kGbrg, "GBRG"}};
  for (const auto& [pattern, name] : patterns) {
    const RgbSensor sensor{.pattern = pattern};
    REQUIRE(sense_mosaic(sensor, {beauty.data()}, context, mosaic.data()));
    REQUIRE(sense_rgb(sensor, {beauty.data()}, context, rgb.data()));
    double worst = 0;
    for (u64 i = 0; i < kPixels; ++i) {
      const u64 x = i % kWidth, y = i / kWidth;
      const int own = int(std::string_view("RGB").find(name[2 * (y % 2) + x % 2]));
      REQUIRE(mosaic[i] == truth(i, own));
      REQUIRE(rgb[3 * i + u64(own)] == mosaic[i]);
      if (x < 2 || y < 2 || x + 2 >= kWidth || y + 2 >= kHeight) continue;
      for (int c = 0; c < 3; ++c)
        worst = std::max(worst, std::abs(double(rgb[3 * i + u64(c)]) - double(truth(i, c))));
    }
    CHECK(worst < 1e-6);
  }
}

TEST_CASE("sensor mosaic: the weights of Malvar, He and Cutler, figure 2, in eighths") {
  const ImageCamera seen_by = camera();
  const Interrupt interrupt;
  std::vector<float> beauty(4 * kPixels, 0.5f), rgb(3 * kPixels);
  const auto pixel = [](u64 x, u64 y) { return y * kWidth + x; };
  beauty[4 * pixel(20, 20)] = 0.75f;  // red at a red photosite
  REQUIRE(sense_rgb({.pattern = RgbSensor::Pattern::kRggb}, {beauty.data()},
                    {seen_by, 1, interrupt}, rgb.data()));
  const auto eighths = [&](u64 x, u64 y) {
    const float* at = rgb.data() + 3 * pixel(x, y);
    return vec3(at[0] - 0.5f, at[1] - 0.5f, at[2] - 0.5f) * 32.0f;
  };
  CHECK(eighths(20, 20) == vec3(8, 4, 6));
  CHECK(eighths(21, 20) == vec3(4, 0, 0));       // green beside red
  CHECK(eighths(20, 19) == vec3(4, 0, 0));       // green above red
  CHECK(eighths(21, 21) == vec3(2, 0, 0));       // blue
  CHECK(eighths(22, 20) == vec3(0, -1, -1.5f));  // red, two on
  CHECK(eighths(20, 18) == vec3(0, -1, -1.5f));
  CHECK(eighths(22, 21) == vec3(0));
  // Green: beside its own kind it counts for red and blue.
  std::ranges::fill(beauty, 0.5f);
  beauty[4 * pixel(21, 20) + 1] = 0.75f;
  REQUIRE(sense_rgb({.pattern = RgbSensor::Pattern::kRggb}, {beauty.data()},
                    {seen_by, 1, interrupt}, rgb.data()));
  CHECK(eighths(21, 20) == vec3(5, 8, 5));
  CHECK(eighths(20, 20) == vec3(0, 2, 0));
  CHECK(eighths(22, 21) == vec3(-1, 0, -1));
  CHECK(eighths(23, 20) == vec3(-1, 0, 0.5f));
  CHECK(eighths(21, 22) == vec3(0.5f, 0, -1));
}

TEST_CASE("sensor mosaic: photosites have noise of their own, which demosaicing mixes") {
  const RgbSensor sensor{.full_well = 2000, .read_noise = 6, .pattern = RgbSensor::Pattern::kGrbg};
  const ImageCamera seen_by = camera();
  const Interrupt interrupt;
  std::vector<float> beauty(4 * kPixels, 0.4f), mosaic(kPixels);
  REQUIRE(sense_mosaic(sensor, {beauty.data()}, {seen_by, 1, interrupt}, mosaic.data()));
  const double variance = (0.4 * 2000 + 36) / 4e6;
  const Moments seen = moments(mosaic);
  CHECK(seen.mean == Approx(0.4).margin(bound_of_mean(variance)));
  CHECK(seen.variance == Approx(variance).margin(bound_of_variance(variance)));
  // Red at blue photosites: the sum of the squares of its weights.
  std::vector<float> rgb(3 * kPixels);
  REQUIRE(sense_rgb(sensor, {beauty.data()}, {seen_by, 1, interrupt}, rgb.data()));
  double square = 0;
  u64 count = 0;
  for (u64 y = 3; y + 2 < kHeight; y += 2)
    for (u64 x = 2; x + 2 < kWidth; x += 2, ++count)
      square += std::pow(double(rgb[3 * (y * kWidth + x)]) - 0.4, 2);
  const double weights = (36 + 4 * 4 + 4 * 2.25) / 64;
  CHECK(square / double(count) == Approx(weights * variance).epsilon(0.05));
}

TEST_CASE("sensor depth: the noise of stereo grows with the square of the depth") {
  const DepthSensor sensor{.baseline = 0.075, .disparity_noise = 0.2};
  for (const double z : {0.5, 1.0, 4.0}) {
    const Moments seen = moments(measure(sensor, [&](u32) { return float(z); }));
    const double deviation = z * z / (300 * 0.075) * 0.2;
    // 1 / (d + noise): the next order of the mean is z (noise / d)^2.
    const double bias = z * std::pow(deviation / z, 2);
    INFO("depth " << z);
    CHECK(seen.mean == Approx(z + bias).margin(bound_of_mean(deviation * deviation) + bias * 0.1));
    CHECK(std::sqrt(seen.variance) ==
          Approx(deviation).epsilon(0.02 + 3 * deviation / z * deviation / z));
  }
}

TEST_CASE("sensor depth: stereo measures steps of disparity") {
  const DepthSensor sensor{.baseline = 0.1, .disparity_step = 0.125};
  const auto out = measure(sensor, [](u32 x) { return 1 + 0.01f * float(x); });
  for (u64 i = 0; i < kPixels; i += 97) {
    if (out[i] == 0) continue;
    const double disparity = 300 * 0.1 / double(out[i]);
    CHECK(disparity / 0.125 == Approx(std::round(disparity / 0.125)).epsilon(1e-5));
    const double depth = 1 + 0.01 * double(i % kWidth);
    CHECK(std::abs(disparity - 30 / depth) <= 0.0625 + 1e-4);
  }
}

TEST_CASE("sensor depth: a projector casts shadows, a window fattens edges") {
  // A pole in columns 200 to 219 at 1 m, disparity 30, before a wall at 3 m, disparity 10.
  const auto pole = [](u32 x) { return x >= 200 && x < 220 ? 1.0f : 3.0f; };
  DepthSensor sensor{.baseline = 0.1};
  auto out = measure(sensor, pole);
  const auto row = [&](u32 x) { return out[u64(100) * kWidth + x]; };
  for (u32 x = 0; x < kWidth; ++x) {
    INFO("column " << x);
    // The pole hides from the projector what lies at its columns less the difference, 20.
    const bool shadow = x >= 180 && x < 200;
    CHECK(double(row(x)) == Approx(shadow ? 0 : pole(x) < 2 ? 1 : 3));
  }
  sensor.window = 7;
  out = measure(sensor, pole);
  CHECK(row(181) == 0);
  CHECK(row(196) == 0);
  CHECK(row(197) == Approx(1));
  CHECK(row(222) == Approx(1));
  CHECK(row(223) == Approx(3));
}

TEST_CASE("sensor depth: time of flight mixes surfaces at edges and follows its signal") {
  const DepthSensor still{.kind = DepthSensor::Kind::kTimeOfFlight, .window = 3};
  const auto edge = [](u32 x) { return x < 200 ? 1.0f : 2.0f; };
  const auto out = measure(still, edge);
  const auto row = [&](u32 x) { return out[u64(124) * kWidth + x]; };
  CHECK(row(198) == Approx(1).epsilon(1e-4));
  CHECK(row(201) == Approx(2).epsilon(1e-4));
  // Six pixels with signal 1 at 1 m, three with 1/4 at 2 m; nearly on the axis.
  CHECK(row(199) == Approx((6 * 1 + 0.75 * 2) / 6.75).epsilon(1e-3));
  CHECK(row(200) == Approx((3 * 1 + 1.5 * 2) / 4.5).epsilon(1e-3));
  const DepthSensor noisy{.kind = DepthSensor::Kind::kTimeOfFlight, .range_noise = 0.01};
  for (const float white : {1.0f, 0.25f}) {
    const auto seen = measure(noisy, [](u32) { return 2.0f; }, white);
    double square = 0, expected = 0;
    for (u64 i = 0; i < kPixels; ++i) {
      const auto line = i / kWidth;
      const double x = (double(i % kWidth) - 199.5) / 300, y = (double(line) - 124.5) / 300;
      const double slant = std::sqrt(1 + x * x + y * y);
      const double signal = double(white) / slant / (4 * slant * slant);
      square += std::pow(double(seen[i]) - 2, 2);
      expected += std::pow(0.01 / std::sqrt(signal) / slant, 2);
    }
    CHECK(square == Approx(expected).epsilon(5 * std::sqrt(2.5 / kPixels)));
  }
}

TEST_CASE("sensor depth: what does not answer reads 0") {
  const auto wall = [](u32) { return 2.0f; };
  const auto holes = [&](const DepthSensor& sensor, float white = 1) {
    const auto out = measure(sensor, wall, white);
    return double(std::count(out.begin(), out.end(), 0.0f)) / kPixels;
  };
  const auto kind = DepthSensor::Kind::kTimeOfFlight;
  CHECK(holes({.kind = kind}) == 0);
  CHECK(holes({.kind = kind, .min_signal = 0.3}) == 1);
  CHECK(holes({.kind = kind, .min_signal = 0.01}, 0.03f) == 1);
  CHECK(holes({.kind = kind, .min_depth = 2.1}) == 1);
  CHECK(holes({.kind = kind, .max_depth = 1.9}) == 1);
  // Rays beyond 0.4 radians from the normal leave a disc of 300 tan(0.4) pixels, cut at the sides.
  const double radius = 300 * std::tan(0.4);
  const double half = kHeight / 2.0, angle = std::asin(half / radius);
  const double disc = 2 * (half * radius * std::cos(angle) + radius * radius * angle);
  CHECK(1 - holes({.kind = kind, .max_angle = 0.4}) == Approx(disc / kPixels).epsilon(0.005));
  const auto sky = measure({.kind = kind}, [](u32) { return INFINITY; });
  CHECK(std::count(sky.begin(), sky.end(), 0.0f) == i64(kPixels));
}
