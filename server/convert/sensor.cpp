// Sensors of cameras.
#include <fmt/format.h>

#include <numbers>

#include "kernels/camera/projection.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

using Kind = DepthSensor::Kind;
using Pattern = RgbSensor::Pattern;

constexpr std::array kPatterns{Pattern::kNone, Pattern::kNone, Pattern::kRggb,
                               Pattern::kBggr, Pattern::kGrbg, Pattern::kGbrg};
static_assert(kPatterns.size() == v1::RgbSensor::Pattern_ARRAYSIZE);
constexpr std::array kKinds{Kind::kActiveStereo, Kind::kActiveStereo, Kind::kTimeOfFlight};
static_assert(kKinds.size() == v1::DepthSensor::Kind_ARRAYSIZE);

constexpr Range kExposure{-64, 64};
constexpr Range kElectrons{0, 1e9};
constexpr Range kReadNoise{0, 1e6};
constexpr Range kBlackLevel{0, 0.9};
constexpr Range kBits{1, 16};
constexpr Range kShare{0, 1};
constexpr Range kBaseline{1e-4, 100};
constexpr Range kNoise{0, 100};
constexpr Range kLateralNoise{0, 16};
constexpr Range kWindow{1, 31};
constexpr Range kSignal{0, 1e6};
constexpr Range kAngle{1e-3, std::numbers::pi / 2};
constexpr Range kDepth{0, 1e9};

std::unexpected<Error> refuse(const char* field, const char* message) {
  return fail(Code::kInvalidArgument, field, message);
}

Status read_stereo(const v1::DepthSensor& message, const Camera& camera, DepthSensor& sensor) {
  if (camera.projection != Projection::kPerspective ||
      std::ranges::any_of(camera.distortion, [](double k) { return k != 0; }))
    return refuse("kind", "active stereo is for perspective cameras without distortion");
  if (message.has_range_noise())
    return refuse("range_noise", "is for time of flight; leave it out");
  if (!message.has_baseline())
    return refuse("baseline", "is missing; give the metres to the projector");
  HELIO_TAKE(sensor.baseline, in_range(message.baseline(), kBaseline), "baseline");
  HELIO_TAKE(sensor.disparity_noise, in_range(message.disparity_noise(), kNoise),
             "disparity_noise");
  HELIO_TAKE(sensor.disparity_step, in_range(message.disparity_step(), kNoise), "disparity_step");
  HELIO_TAKE(sensor.lateral_noise, in_range(message.lateral_noise(), kLateralNoise),
             "lateral_noise");
  return {};
}

Status read_time_of_flight(const v1::DepthSensor& message, const Camera& camera,
                           DepthSensor& sensor) {
  if (kernels::is_parallel(camera.projection))
    return refuse("kind", "an orthographic camera has no depth sensor; leave it out");
  for (const auto& [given, field] : {std::pair{message.has_baseline(), "baseline"},
                                     {message.has_disparity_noise(), "disparity_noise"},
                                     {message.has_disparity_step(), "disparity_step"},
                                     {message.has_lateral_noise(), "lateral_noise"}})
    if (given) return refuse(field, "is for active stereo; leave it out");
  HELIO_TAKE(sensor.range_noise, in_range(message.range_noise(), kNoise), "range_noise");
  return {};
}

}  // namespace

Expected<RgbSensor> to_rgb_sensor(const v1::RgbSensor& message) {
  RgbSensor sensor;
  HELIO_TAKE(sensor.exposure, in_range(message.exposure(), kExposure), "exposure");
  HELIO_TAKE(sensor.full_well, in_range(message.full_well(), kElectrons), "full_well");
  HELIO_TAKE(sensor.read_noise, in_range(message.read_noise(), kReadNoise), "read_noise");
  if (sensor.read_noise > 0 && sensor.full_well == 0)
    return refuse("full_well", "is 0; read_noise needs the electrons of a full well");
  HELIO_TAKE(sensor.black_level, in_range(message.black_level(), kBlackLevel), "black_level");
  if (message.bits() != 0) HELIO_TAKE(sensor.bits, in_range(message.bits(), kBits), "bits");
  HELIO_TAKE(sensor.vignetting, in_range(message.vignetting(), kShare), "vignetting");
  sensor.pattern = from_enum(kPatterns, message.pattern());
  return sensor;
}

v1::RgbSensor to_proto(const RgbSensor& sensor) {
  v1::RgbSensor message;
  message.set_exposure(sensor.exposure);
  message.set_full_well(sensor.full_well);
  message.set_read_noise(sensor.read_noise);
  message.set_black_level(sensor.black_level);
  message.set_bits(sensor.bits);
  message.set_vignetting(sensor.vignetting);
  message.set_pattern(to_enum<v1::RgbSensor::Pattern>(kPatterns, sensor.pattern));
  return message;
}

Expected<DepthSensor> to_depth_sensor(const v1::DepthSensor& message, const Camera& camera) {
  DepthSensor sensor{.kind = from_enum(kKinds, message.kind())};
  HELIO_TRY(sensor.kind == Kind::kActiveStereo ? read_stereo(message, camera, sensor)
                                               : read_time_of_flight(message, camera, sensor));
  if (message.has_window())
    HELIO_TAKE(sensor.window, in_range(message.window(), kWindow), "window");
  if (sensor.window % 2 == 0) return refuse("window", "is even; give an odd number of pixels");
  HELIO_TAKE(sensor.min_signal, in_range(message.min_signal(), kSignal), "min_signal");
  if (message.has_max_angle())
    HELIO_TAKE(sensor.max_angle, in_range(message.max_angle(), kAngle), "max_angle");
  HELIO_TAKE(sensor.min_depth, in_range(message.min_depth(), kDepth), "min_depth");
  HELIO_TAKE(sensor.max_depth, in_range(message.max_depth(), kDepth), "max_depth");
  if (sensor.max_depth > 0 && sensor.max_depth <= sensor.min_depth)
    return refuse("max_depth", "is not beyond min_depth; give more, or 0 for none");
  return sensor;
}

v1::DepthSensor to_proto(const DepthSensor& sensor) {
  v1::DepthSensor message;
  message.set_kind(to_enum<v1::DepthSensor::Kind>(kKinds, sensor.kind));
  if (sensor.kind == Kind::kActiveStereo) {
    message.set_baseline(sensor.baseline);
    message.set_disparity_noise(sensor.disparity_noise);
    message.set_disparity_step(sensor.disparity_step);
    message.set_lateral_noise(sensor.lateral_noise);
  } else {
    message.set_range_noise(sensor.range_noise);
  }
  message.set_window(sensor.window);
  message.set_min_signal(sensor.min_signal);
  message.set_max_angle(sensor.max_angle);
  message.set_min_depth(sensor.min_depth);
  message.set_max_depth(sensor.max_depth);
  return message;
}

}  // namespace heliograph::server
