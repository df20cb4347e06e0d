// The model of a colour sensor.
#include <algorithm>
#include <cmath>

#include "kernels/distortion.h"
#include "renderer/engine/sensor.h"
#include "renderer/engine/sensor_noise.h"

namespace heliograph {
namespace {

/// The cosine of the angle between the optical axis and what pixel (x, y) sees, at least 0.
double cosine_at(const ImageCamera& camera, u32 x, u32 y) {
  const glm::dvec2 m((x - camera.k[2][0]) / camera.k[0][0], (y - camera.k[2][1]) / camera.k[1][1]);
  glm::dvec3 d;
  if (camera.lens.projection == kernels::Projection::kOrthographic) return 1;
  if (!kernels::unproject(camera.lens, m, d)) return 0;
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

}  // namespace

Status sense_rgb(const RgbSensor& sensor, const RgbImage& image, const SensorContext& context,
                 float* out) {
  const ImageCamera& camera = context.camera;
  const double gain = std::exp2(sensor.exposure);
  for (u32 y = 0; y < camera.height; ++y) {
    HELIO_TRY(context.interrupt.status());
    for (u32 x = 0; x < camera.width; ++x) {
      const u64 pixel = u64(y) * camera.width + x;
      SensorNoise noise(context.seed, pixel);
      double light = gain;
      if (sensor.vignetting > 0)
        light *= 1 - sensor.vignetting + sensor.vignetting * std::pow(cosine_at(camera, x, y), 4);
      for (u32 channel = 0; channel < 3; ++channel) {
        const double signal = std::max(0.0, light * double(image.beauty[4 * pixel + channel]));
        out[3 * pixel + channel] = float(read_out(sensor, signal, noise));
      }
    }
  }
  return {};
}

}  // namespace heliograph
