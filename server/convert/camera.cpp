// Cameras of entities: intrinsics, lens, clipping, sensors.
#include <fmt/format.h>

#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr std::array kProjections{Projection::kPerspective, Projection::kPerspective,
                                  Projection::kOrthographic, Projection::kFisheye,
                                  Projection::kEquirectangular};
static_assert(kProjections.size() == v1::Camera::Projection_ARRAYSIZE);

constexpr Range kImageSide{1, 16384};
constexpr Range kFocalLength{1e-6, 1e9};
constexpr Range kPrincipalPoint{-1e9, 1e9};
constexpr Range kAperture{0, 1e3};
constexpr Range kFocusDistance{1e-6, 1e9};
constexpr Range kBlades{3, 64};
constexpr Range kAngle{-1e3, 1e3};
constexpr Range kClip{0, 1e9};
constexpr Range kCoefficient{-1e6, 1e6};
constexpr Range kShutter{-1000, 1000};

Status require(bool present, const char* field, const char* remedy) {
  if (present) return {};
  return fail(Code::kInvalidArgument, field, std::string("is missing; ") + remedy);
}

Status read_intrinsics(const v1::Camera& message, Camera& camera) {
  HELIO_TRY(require(message.has_width(), "width", "give the calibrated size in pixels"));
  HELIO_TRY(require(message.has_height(), "height", "give the calibrated size in pixels"));
  HELIO_TRY(require(message.has_fx(), "fx", "give the focal length in pixels"));
  HELIO_TRY(
      require(message.has_fy(), "fy", "give the focal length in pixels (fx for square ones)"));
  HELIO_TRY(require(message.has_cx(), "cx", "the image's centre is (width - 1) / 2"));
  HELIO_TRY(require(message.has_cy(), "cy", "the image's centre is (height - 1) / 2"));
  HELIO_TAKE(camera.width, in_range(message.width(), kImageSide), "width");
  HELIO_TAKE(camera.height, in_range(message.height(), kImageSide), "height");
  camera.projection = from_enum(kProjections, message.projection());
  HELIO_TAKE(camera.fx, in_range(message.fx(), kFocalLength), "fx");
  HELIO_TAKE(camera.fy, in_range(message.fy(), kFocalLength), "fy");
  HELIO_TAKE(camera.cx, in_range(message.cx(), kPrincipalPoint), "cx");
  HELIO_TAKE(camera.cy, in_range(message.cy(), kPrincipalPoint), "cy");
  return {};
}

Status read_aperture(const v1::Camera& message, Camera& camera) {
  HELIO_TAKE(camera.aperture, in_range(message.aperture(), kAperture), "aperture");
  if (message.blades() != 0)
    HELIO_TAKE(camera.blades, in_range(message.blades(), kBlades), "blades");
  HELIO_TAKE(camera.blade_rotation, in_range(message.blade_rotation(), kAngle), "blade_rotation");
  if (message.focus_distance() != 0 || camera.aperture > 0)
    HELIO_TAKE(camera.focus_distance, in_range(message.focus_distance(), kFocusDistance),
               "focus_distance");
  if (camera.aperture > 0 && camera.projection != Projection::kPerspective &&
      camera.projection != Projection::kOrthographic)
    return fail(Code::kInvalidArgument, "aperture",
                "is for perspective and orthographic cameras; leave it out");
  return {};
}

Status read_clip(const v1::Camera& message, Camera& camera) {
  HELIO_TAKE(camera.near, in_range(message.near(), kClip), "near");
  HELIO_TAKE(camera.far, in_range(message.far(), kClip), "far");
  if (camera.far == 0 || camera.near < camera.far) return {};
  return fail(Code::kInvalidArgument, "far",
              fmt::format("{} is not beyond near, {}; give more, or 0 for no end", camera.far,
                          camera.near));
}

Status read_distortion(const v1::Camera& message, Camera& camera) {
  const int count = message.distortion_size();
  if (count == 0) return {};
  switch (camera.projection) {
    case Projection::kPerspective:
      if (count == 4 || count == 5 || count == 8) break;
      return fail(
          Code::kInvalidArgument, "distortion",
          fmt::format("has {} numbers; give k1 k2 p1 p2, with k3, or with k3 k4 k5 k6 (thin "
                      "prisms and tilted sensors are not modelled)",
                      count));
    case Projection::kFisheye:
      if (count == 4) break;
      return fail(Code::kInvalidArgument, "distortion",
                  fmt::format("has {} numbers; a fisheye lens has k1 k2 k3 k4", count));
    case Projection::kOrthographic:
    case Projection::kEquirectangular:
      return fail(Code::kInvalidArgument, "distortion",
                  "is for perspective and fisheye cameras; leave it out");
  }
  for (int i = 0; i < count; ++i)
    HELIO_TAKE(camera.distortion[std::size_t(i)], in_range(message.distortion(i), kCoefficient),
               indexed("distortion", u64(i)));
  return {};
}

/// Returns the number of coefficients needed: 0, 4, 5 or 8.
std::size_t coefficients_of(const Camera& camera) {
  const auto zero = [](double k) { return k == 0; };
  const auto& k = camera.distortion;
  if (!std::all_of(k.begin() + 5, k.end(), zero)) return 8;
  if (k[4] != 0) return 5;
  return std::ranges::all_of(k, zero) ? 0 : 4;
}

Expected<Shutter> to_shutter(const v1::Shutter& message) {
  Shutter shutter;
  HELIO_TAKE(shutter.open, in_range(message.open(), kShutter), "open");
  HELIO_TAKE(shutter.close, in_range(message.close(), kShutter), "close");
  HELIO_TAKE(shutter.rolling, in_range(message.rolling(), {0, kShutter.high}), "rolling");
  if (shutter.close < shutter.open)
    return fail(Code::kInvalidArgument, "close",
                fmt::format("is {:g} s, before open, {:g} s; give close >= open", shutter.close,
                            shutter.open));
  return shutter;
}

}  // namespace

Expected<Camera> to_camera(const v1::Camera& message) {
  Camera camera;
  HELIO_TRY(read_intrinsics(message, camera));
  HELIO_TRY(read_aperture(message, camera));
  HELIO_TRY(read_clip(message, camera));
  HELIO_TRY(read_distortion(message, camera));
  if (message.has_rgb_sensor())
    HELIO_TAKE(camera.rgb_sensor, to_rgb_sensor(message.rgb_sensor()), "rgb_sensor");
  if (message.has_depth_sensor())
    HELIO_TAKE(camera.depth_sensor, to_depth_sensor(message.depth_sensor(), camera),
               "depth_sensor");
  if (message.has_shutter()) HELIO_TAKE(camera.shutter, to_shutter(message.shutter()), "shutter");
  return camera;
}

v1::Shutter to_proto(const Shutter& shutter) {
  v1::Shutter message;
  message.set_open(shutter.open);
  message.set_close(shutter.close);
  message.set_rolling(shutter.rolling);
  return message;
}

v1::Camera to_proto(const Camera& camera) {
  v1::Camera message;
  message.set_width(camera.width);
  message.set_height(camera.height);
  message.set_projection(to_enum<v1::Camera::Projection>(kProjections, camera.projection));
  message.set_fx(camera.fx);
  message.set_fy(camera.fy);
  message.set_cx(camera.cx);
  message.set_cy(camera.cy);
  message.set_aperture(camera.aperture);
  message.set_focus_distance(camera.focus_distance);
  message.set_blades(camera.blades);
  message.set_blade_rotation(camera.blade_rotation);
  message.set_near(camera.near);
  message.set_far(camera.far);
  for (std::size_t i = 0; i < coefficients_of(camera); ++i)
    message.add_distortion(camera.distortion[i]);
  if (camera.rgb_sensor) *message.mutable_rgb_sensor() = to_proto(*camera.rgb_sensor);
  if (camera.depth_sensor) *message.mutable_depth_sensor() = to_proto(*camera.depth_sensor);
  if (camera.shutter != Shutter{}) *message.mutable_shutter() = to_proto(camera.shutter);
  return message;
}

}  // namespace heliograph::server
