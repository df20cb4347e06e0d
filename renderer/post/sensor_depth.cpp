// The models of depth cameras: active stereo, which matches a projected pattern along rows, and
// time of flight.
#include <algorithm>
#include <cmath>
#include <vector>

#include "kernels/camera/projection.h"
#include "renderer/base/parallel.h"
#include "renderer/post/sensor.h"
#include "renderer/post/sensor_noise.h"

namespace heliograph {
namespace {

constexpr double kEdge = 1;  // pixels of disparity by which a surface must be nearer to fatten

/// Answer of a pixel to the sensor.
struct Echo {
  double measure = 0;   // metres: what the sensor reports
  double distance = 0;  // metres along the ray
  double signal = 0;    // of a white, matt surface at 1 m that faces the sensor: 1; 0: nothing
};

/// Light of the sensor that returns: diffuse reflection, the cosine and the inverse square. What
/// smooth metal mirrors goes elsewhere; clear glass neither answers nor casts a shadow.
Echo echo_at(const DepthSensor& sensor, const DepthImage& image, const ImageCamera& camera,
             u64 pixel) {
  const bool along_axis = kernels::is_straight(camera.lens.projection);
  Echo echo{.measure = double(along_axis ? image.depth[pixel] : image.distance[pixel]),
            .distance = double(image.distance[pixel])};
  if (!std::isfinite(echo.distance) || image.transmission[pixel] >= 0.5f) return {};
  glm::dvec3 d;
  if (!direction_of(camera, u32(pixel % camera.width), u32(pixel / camera.width), d)) return {};
  const double length = glm::length(d);
  const float* n = image.normal_camera + 3 * pixel;
  const double cosine = -glm::dot(glm::dvec3(double(n[0]), double(n[1]), double(n[2])), d) / length;
  if (!(cosine > std::cos(sensor.max_angle))) return echo;
  const float* c = image.base_color + 3 * pixel;
  const double white = 0.2126 * double(c[0]) + 0.7152 * double(c[1]) + 0.0722 * double(c[2]);
  const double matt = (1 - double(image.transmission[pixel])) *
                      (1 - double(image.metallic[pixel]) * (1 - double(image.roughness[pixel])));
  echo.signal = white * matt * cosine / (echo.distance * echo.distance);
  if (!(echo.signal >= sensor.min_signal)) echo.signal = 0;
  return echo;
}

double within_range(const DepthSensor& sensor, double depth) {
  if (depth < sensor.min_depth) return 0;
  return sensor.max_depth > 0 && depth > sensor.max_depth ? 0 : depth;
}

/// Disparities of one camera against the projector at +x of it; 0: none is measured.
class DisparityMap {
 public:
  DisparityMap(const DepthSensor& sensor, const ImageCamera& camera, std::vector<Echo> echoes)
      : width_(i32(camera.width)), height_(i32(camera.height)), values_(echoes.size()) {
    const double scale = camera.k[0][0] * sensor.baseline;
    for (u64 i = 0; i < echoes.size(); ++i)
      if (echoes[i].measure > 0) values_[i] = scale / echoes[i].measure;
    surfaces_ = values_;
    drop_shadows();
    for (u64 i = 0; i < echoes.size(); ++i)
      if (!(echoes[i].signal > 0)) values_[i] = 0;
  }

  /// The disparity that a window about (x, y) matches: the nearest surface in it takes it over.
  [[nodiscard]] double matched(i32 x, i32 y, i32 reach) const {
    x = std::clamp(x, 0, width_ - 1);
    y = std::clamp(y, 0, height_ - 1);
    const double surface = surfaces_[u64(y) * u64(width_) + u64(x)];
    double nearest = 0;
    for (i32 v = std::max(0, y - reach); v <= std::min(height_ - 1, y + reach); ++v)
      for (i32 u = std::max(0, x - reach); u <= std::min(width_ - 1, x + reach); ++u)
        nearest = std::max(nearest, at(u, v));
    return nearest > surface + kEdge ? nearest : at(x, y);
  }

 private:
  [[nodiscard]] double at(i32 x, i32 y) const { return values_[u64(y) * u64(width_) + u64(x)]; }
  /// Drops what the projector does not see: in its column, too, a nearer surface lies. Columns that
  /// a surface skips because it slants are its own.
  void drop_shadows() {
    std::vector<double> nearest(2 * u64(width_));
    for (i32 y = 0; y < height_; ++y) {
      double* row = values_.data() + u64(y) * u64(width_);
      const auto column = [&](i32 x) {
        return i32(std::lround(std::max(double(x) - row[x], -double(width_)))) + width_;
      };
      std::ranges::fill(nearest, 0);
      for (i32 x = 0; x < width_; ++x) {
        const bool joined = x > 0 && row[x] > 0 && std::abs(row[x] - row[x - 1]) <= kEdge;
        const i32 from = joined ? std::min(column(x - 1) + 1, column(x)) : column(x);
        for (i32 c = from; c <= column(x); ++c) nearest[u64(c)] = std::max(nearest[u64(c)], row[x]);
      }
      for (i32 x = 0; x < width_; ++x)
        if (nearest[u64(column(x))] > row[x] + kEdge) row[x] = 0;
    }
  }

  i32 width_, height_;
  std::vector<double> values_;
  std::vector<double> surfaces_;  // whether they are measured or not
};

/// Handa et al. 2014, section III (after Barron and Malik 2013): pixels shift sideways at random,
/// disparities get noise and are quantised. The error grows with the square of the depth:
/// Khoshelham and Elberink 2012, equation 10.
Status active_stereo(const DepthSensor& sensor, const SensorContext& context,
                     std::vector<Echo> echoes, float* out) {
  const ImageCamera& camera = context.camera;
  const DisparityMap map(sensor, camera, std::move(echoes));
  const double scale = camera.k[0][0] * sensor.baseline;
  const i32 reach = (i32(std::max(1u, sensor.window)) - 1) / 2;
  parallel_for(camera.height, [&](u32 y) {
    if (context.interrupt.requested()) return;
    for (u32 x = 0; x < camera.width; ++x) {
      const u64 pixel = u64(y) * camera.width + x;
      SensorNoise noise(context.seed, pixel);
      const auto shifted = [&](u32 at) {
        return i32(std::lround(double(at) + sensor.lateral_noise * noise.normal()));
      };
      const i32 u = shifted(x), v = shifted(y);
      double disparity = map.matched(u, v, reach);
      out[pixel] = 0;
      if (!(disparity > 0)) continue;
      disparity += sensor.disparity_noise * noise.normal();
      if (sensor.disparity_step > 0)
        disparity = std::round(disparity / sensor.disparity_step) * sensor.disparity_step;
      if (disparity > 0) out[pixel] = float(within_range(sensor, scale / disparity));
    }
  });
  return context.interrupt.status();
}

/// The distance is the mean over the pixel's footprint, by signal: at an edge it lies between the
/// surfaces ("flying pixels"). Its noise falls with the root of the signal (shot noise).
///
/// Source: Lange 2000, "3D Time-of-Flight Distance Measurement with Custom Solid-State Image
/// Sensors in CMOS/CCD-Technology", section 4.2; Foix et al. 2011, "Lock-in Time-of-Flight (ToF)
/// Cameras: A Survey".
Status time_of_flight(const DepthSensor& sensor, const SensorContext& context,
                      const std::vector<Echo>& echoes, float* out) {
  const ImageCamera& camera = context.camera;
  const i32 width = i32(camera.width), height = i32(camera.height);
  const i32 reach = (i32(std::max(1u, sensor.window)) - 1) / 2;
  parallel_for(height, [&](i32 y) {
    if (context.interrupt.requested()) return;
    for (i32 x = 0; x < width; ++x) {
      const u64 pixel = u64(y) * u64(width) + u64(x);
      double signal = 0, distance = 0;
      for (i32 v = std::max(0, y - reach); v <= std::min(height - 1, y + reach); ++v)
        for (i32 u = std::max(0, x - reach); u <= std::min(width - 1, x + reach); ++u) {
          const Echo& echo = echoes[u64(v) * u64(width) + u64(u)];
          signal += echo.signal;
          distance += echo.signal * echo.distance;
        }
      out[pixel] = 0;
      const Echo& own = echoes[pixel];
      if (!(signal > 0) || !(own.signal > 0)) continue;
      SensorNoise noise(context.seed, pixel);
      const double area = double((2 * reach + 1) * (2 * reach + 1));
      distance = distance / signal + sensor.range_noise / std::sqrt(signal / area) * noise.normal();
      if (distance > 0)
        out[pixel] = float(within_range(sensor, distance * own.measure / own.distance));
    }
  });
  return context.interrupt.status();
}

}  // namespace

Status sense_depth(const DepthSensor& sensor, const DepthImage& image, const SensorContext& context,
                   float* out) {
  const ImageCamera& camera = context.camera;
  std::vector<Echo> echoes(u64(camera.width) * camera.height);
  parallel_for(camera.height, [&](u32 y) {
    const u64 row = u64(y) * camera.width;
    for (u64 i = row; i < row + camera.width; ++i) echoes[i] = echo_at(sensor, image, camera, i);
  });
  if (sensor.kind == DepthSensor::Kind::kActiveStereo)
    return active_stereo(sensor, context, std::move(echoes), out);
  return time_of_flight(sensor, context, echoes, out);
}

}  // namespace heliograph
