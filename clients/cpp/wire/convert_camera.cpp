// Cameras and sensors, both ways.
#include <cmath>
#include <limits>

#include "wire/arrays.h"
#include "wire/convert.h"

namespace heliograph::client::wire {
namespace {

void put_rgb(const RgbSensor& sensor, v1::RgbSensor* out) {
  out->set_exposure(sensor.exposure);
  out->set_full_well(sensor.full_well);
  out->set_read_noise(sensor.read_noise);
  out->set_black_level(sensor.black_level);
  out->set_bits(sensor.bits);
  out->set_vignetting(sensor.vignetting);
  out->set_pattern(v1::RgbSensor::Pattern(sensor.pattern));
}

RgbSensor rgb_of(const v1::RgbSensor& message) {
  RgbSensor out;
  out.exposure = message.exposure();
  out.full_well = message.full_well();
  out.read_noise = message.read_noise();
  out.black_level = message.black_level();
  out.bits = message.bits();
  out.vignetting = message.vignetting();
  if (message.pattern() != 0) out.pattern = RgbSensor::Pattern(message.pattern());
  return out;
}

/// A number of the other kind is sent to be refused.
void put_depth(const DepthSensor& sensor, v1::DepthSensor* out) {
  const bool is_stereo = sensor.kind == DepthSensor::Kind::kActiveStereo;
  out->set_kind(v1::DepthSensor::Kind(sensor.kind));
  out->set_window(sensor.window);
  out->set_min_signal(sensor.min_signal);
  out->set_max_angle(sensor.max_angle);
  out->set_min_depth(sensor.min_depth);
  out->set_max_depth(sensor.max_depth);
  if (is_stereo || sensor.baseline != 0) out->set_baseline(sensor.baseline);
  if (is_stereo || sensor.disparity_noise != 0) out->set_disparity_noise(sensor.disparity_noise);
  if (is_stereo || sensor.disparity_step != 0) out->set_disparity_step(sensor.disparity_step);
  if (is_stereo || sensor.lateral_noise != 0) out->set_lateral_noise(sensor.lateral_noise);
  if (!is_stereo || sensor.range_noise != 0) out->set_range_noise(sensor.range_noise);
}

DepthSensor depth_of(const v1::DepthSensor& message) {
  DepthSensor out;
  if (message.kind() != 0) out.kind = DepthSensor::Kind(message.kind());
  out.baseline = message.baseline();
  out.disparity_noise = message.disparity_noise();
  out.disparity_step = message.disparity_step();
  out.lateral_noise = message.lateral_noise();
  out.range_noise = message.range_noise();
  out.window = message.window();
  out.min_signal = message.min_signal();
  out.max_angle = message.max_angle();
  out.min_depth = message.min_depth();
  out.max_depth = message.max_depth();
  return out;
}

void put_ray_table(const RayTable& table, Draft& draft, v1::RayTable* out) {
  put_asset(as_f32(table.rays, "rays"), draft, out->mutable_rays());
  if (!table.times.empty()) put_asset(as_f32(table.times, "times"), draft, out->mutable_times());
  out->set_interpolated(table.interpolated);
}

}  // namespace

void put_camera(const Camera& camera, Draft& draft, v1::Camera* out) {
  out->set_width(camera.width);
  out->set_height(camera.height);
  out->set_projection(v1::Camera::Projection(camera.projection));
  out->set_blades(camera.blades);
  out->mutable_distortion()->Add(camera.distortion.begin(), camera.distortion.end());
  if (camera.rays) {
    put_ray_table(*camera.rays, draft, out->mutable_rays());
  } else {
    out->set_fx(camera.fx);
    out->set_fy(camera.fy);
    out->set_cx(camera.cx);
    out->set_cy(camera.cy);
  }
  out->set_aperture(camera.aperture);
  out->set_focus_distance(camera.focus_distance);
  out->set_blade_rotation(camera.blade_rotation);
  out->set_near(camera.near);
  if (!std::isinf(camera.far)) out->set_far(camera.far);
  if (camera.rgb_sensor) put_rgb(*camera.rgb_sensor, out->mutable_rgb_sensor());
  if (camera.depth_sensor) put_depth(*camera.depth_sensor, out->mutable_depth_sensor());
  if (camera.shutter[0] == 0 && camera.shutter[1] == 0 && camera.rolling == 0) return;
  out->mutable_shutter()->set_open(camera.shutter[0]);
  out->mutable_shutter()->set_close(camera.shutter[1]);
  out->mutable_shutter()->set_rolling(camera.rolling);
}

Camera camera_of(const v1::Camera& message) {
  Camera out;
  out.width = message.width();
  out.height = message.height();
  if (message.projection() != 0) out.projection = Camera::Projection(message.projection());
  out.blades = message.blades();
  out.distortion.assign(message.distortion().begin(), message.distortion().end());
  out.fx = message.fx();
  out.fy = message.fy();
  out.cx = message.cx();
  out.cy = message.cy();
  out.aperture = message.aperture();
  out.focus_distance = message.focus_distance();
  out.blade_rotation = message.blade_rotation();
  out.near = message.near();
  out.far = message.far() == 0 ? std::numeric_limits<double>::infinity() : message.far();
  out.shutter = {message.shutter().open(), message.shutter().close()};
  out.rolling = message.shutter().rolling();
  if (message.has_rgb_sensor()) out.rgb_sensor = rgb_of(message.rgb_sensor());
  if (message.has_depth_sensor()) out.depth_sensor = depth_of(message.depth_sensor());
  return out;
}

}  // namespace heliograph::client::wire
