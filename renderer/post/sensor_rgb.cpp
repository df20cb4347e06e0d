// The model of a colour sensor, with or without a mosaic of colours.
#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "renderer/base/parallel.h"
#include "renderer/post/sensor.h"
#include "renderer/post/sensor_noise.h"

namespace heliograph {
namespace {

/// The cosine of the angle between the optical axis and what pixel (x, y) sees, at least 0.
double cosine_at(const ImageCamera& camera, u32 x, u32 y) {
  glm::dvec3 d;
  if (!direction_of(camera, x, y, d)) return 0;
  return std::max(0.0, d.z / glm::length(d));
}

/// From the share of the full well that light fills, to what is read out.
double read_out(const RgbSensor& sensor, double signal, SensorNoise& noise) {
  if (sensor.full_well > 0) {
    const double electrons = noise.poisson(std::min(signal, 1e6) * sensor.full_well);
    signal = (electrons + sensor.read_noise * noise.normal()) / sensor.full_well;
  }
  const double level = sensor.black_level + (1 - sensor.black_level) * signal;
  const double clipped = std::clamp(level, 0.0, 1.0);
  if (sensor.bits == 0) return clipped;
  const double steps = std::exp2(sensor.bits) - 1;
  return std::round(clipped * steps) / steps;
}

/// Readings of a sensor from an image, photosite by photosite.
class Readout {
 public:
  Readout(const RgbSensor& sensor, const RgbImage& image, const SensorContext& context)
      : sensor_(sensor), image_(image), context_(context), gain_(std::exp2(sensor.exposure)) {}

  /// Some channels of a pixel, which share its random numbers.
  void read(u32 x, u32 y, std::span<const u32> channels, float* out) const {
    const ImageCamera& camera = context_.camera;
    const u64 pixel = u64(y) * camera.width + x;
    SensorNoise noise(context_.seed, pixel);
    double light = gain_;
    if (sensor_.vignetting > 0)
      light *= 1 - sensor_.vignetting + sensor_.vignetting * std::pow(cosine_at(camera, x, y), 4);
    for (const u32 channel : channels) {
      const double signal = std::max(0.0, light * double(image_.beauty[4 * pixel + channel]));
      *out++ = float(read_out(sensor_, signal, noise));
    }
  }

 private:
  const RgbSensor& sensor_;
  const RgbImage& image_;
  const SensorContext& context_;
  const double gain_;
};

/// The channel that a photosite measures.
u32 channel_of(RgbSensor::Pattern pattern, u32 x, u32 y) {
  constexpr u8 kTiles[][4] = {{0, 1, 1, 2}, {2, 1, 1, 0}, {1, 0, 2, 1}, {1, 2, 0, 1}};
  return kTiles[u32(pattern) - 1][2 * (y & 1) + (x & 1)];
}

/// Demosaics one photosite at a time. Beyond its borders an image is mirrored at its outermost
/// photosites, which keeps the pattern.
class Demosaic {
 public:
  Demosaic(const std::vector<float>& mosaic, const ImageCamera& camera)
      : mosaic_(mosaic), width_(camera.width), height_(camera.height) {}

  [[nodiscard]] std::array<float, 3> at(RgbSensor::Pattern pattern, u32 x, u32 y) const {
    const double here = value(x, y, 0, 0);
    const double beside = value(x, y, -1, 0) + value(x, y, 1, 0);
    const double above = value(x, y, 0, -1) + value(x, y, 0, 1);
    const double beside2 = value(x, y, -2, 0) + value(x, y, 2, 0);
    const double above2 = value(x, y, 0, -2) + value(x, y, 0, 2);
    const double corners =
        value(x, y, -1, -1) + value(x, y, 1, -1) + value(x, y, -1, 1) + value(x, y, 1, 1);
    std::array<double, 3> out{};
    const u32 own = channel_of(pattern, x, y);
    out[own] = here;
    if (own == 1) {
      const u32 row = channel_of(pattern, x ^ 1, y);  // of the neighbours beside it
      out[row] = (5 * here + 4 * beside - beside2 - corners + 0.5 * above2) / 8;
      out[2 - row] = (5 * here + 4 * above - above2 - corners + 0.5 * beside2) / 8;
    } else {
      out[1] = (4 * here + 2 * (beside + above) - beside2 - above2) / 8;
      out[2 - own] = (6 * here + 2 * corners - 1.5 * (beside2 + above2)) / 8;
    }
    std::array<float, 3> clipped{};
    for (u32 i = 0; i < 3; ++i) clipped[i] = float(std::clamp(out[i], 0.0, 1.0));
    return clipped;
  }

 private:
  static u32 mirrored(i64 at, u32 size) {
    if (size == 1) return 0;
    const i64 last = i64(size) - 1;
    at = std::abs(at) % (2 * last);
    return u32(at > last ? 2 * last - at : at);
  }
  [[nodiscard]] double value(u32 x, u32 y, i64 right, i64 down) const {
    const u64 row = mirrored(i64(y) + down, height_);
    return double(mosaic_[row * width_ + mirrored(i64(x) + right, width_)]);
  }
  const std::vector<float>& mosaic_;
  const u32 width_, height_;
};

/// Calls f for each pixel (x, y) and its number, rows in any order, until it is time to stop.
Status for_each_pixel(const SensorContext& context, const auto& f) {
  const u32 width = context.camera.width;
  parallel_for(context.camera.height, [&](u32 y) {
    if (context.interrupt.requested()) return;
    for (u32 x = 0; x < width; ++x) f(x, y, u64(y) * width + x);
  });
  return context.interrupt.status();
}

}  // namespace

Status sense_mosaic(const RgbSensor& sensor, const RgbImage& image, const SensorContext& context,
                    float* out) {
  const Readout readout(sensor, image, context);
  return for_each_pixel(context, [&](u32 x, u32 y, u64 pixel) {
    const u32 channel = channel_of(sensor.pattern, x, y);
    readout.read(x, y, {&channel, 1}, out + pixel);
  });
}

Status sense_rgb(const RgbSensor& sensor, const RgbImage& image, const SensorContext& context,
                 float* out) {
  if (sensor.pattern == RgbSensor::Pattern::kNone) {
    constexpr std::array kAll{0u, 1u, 2u};
    const Readout readout(sensor, image, context);
    return for_each_pixel(
        context, [&](u32 x, u32 y, u64 pixel) { readout.read(x, y, kAll, out + 3 * pixel); });
  }
  std::vector<float> mosaic(std::size_t(context.camera.width) * context.camera.height);
  HELIO_TRY(sense_mosaic(sensor, image, context, mosaic.data()));
  const Demosaic demosaic(mosaic, context.camera);
  return for_each_pixel(context, [&](u32 x, u32 y, u64 pixel) {
    std::ranges::copy(demosaic.at(sensor.pattern, x, y), out + 3 * pixel);
  });
}

}  // namespace heliograph
