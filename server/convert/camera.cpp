// Cameras of entities: intrinsics, lens, clipping, sensors.
#include <fmt/format.h>

#include "kernels/camera/projection.h"
#include "renderer/scene/ray_table.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

// One more than the kernels' number; 0 (unspecified) is perspective.
#define HELIO_PROJECTION(Name) +1
static_assert(v1::Camera::Projection_ARRAYSIZE == 1 HELIO_PROJECTIONS(HELIO_PROJECTION));
#undef HELIO_PROJECTION
static_assert(v1::Camera::PROJECTION_RAY_TABLE == int(Projection::kRayTable) + 1);

Projection to_projection(v1::Camera::Projection message) {
  return Projection(std::max(int(message), 1) - 1);
}

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

Status read_size(const v1::Camera& message, Camera& camera) {
  HELIO_TRY(require(message.has_width(), "width", "give the calibrated size in pixels"));
  HELIO_TRY(require(message.has_height(), "height", "give the calibrated size in pixels"));
  HELIO_TAKE(camera.width, in_range(message.width(), kImageSide), "width");
  HELIO_TAKE(camera.height, in_range(message.height(), kImageSide), "height");
  return {};
}

/// A ray table, which has its own rays and times in place of a lens.
Status read_rays(const v1::Camera& message, ArraySource& source, Camera& camera) {
  for (const auto& [given, field] : {std::pair{message.fx() != 0, "fx"},
                                     {message.fy() != 0, "fy"},
                                     {message.cx() != 0, "cx"},
                                     {message.cy() != 0, "cy"},
                                     {message.aperture() != 0, "aperture"},
                                     {message.shutter().rolling() != 0, "shutter.rolling"}})
    if (given)
      return fail(Code::kInvalidArgument, field, "says nothing of a ray table; leave it out");
  HELIO_TRY(require(message.has_rays(), "rays", "give the rays of a ray table"));
  const uvec2 size(camera.width, camera.height);
  HELIO_TAKE(camera.rays, to_ray_table(message.rays(), size, source), "rays");
  camera.cx = 0.5 * size.x - 0.5;
  camera.cy = 0.5 * size.y - 0.5;
  return {};
}

Status read_intrinsics(const v1::Camera& message, Camera& camera) {
  HELIO_TRY(require(message.has_fx(), "fx", "give the focal length in pixels"));
  HELIO_TRY(
      require(message.has_fy(), "fy", "give the focal length in pixels (fx for square ones)"));
  HELIO_TRY(require(message.has_cx(), "cx", "the image's centre is (width - 1) / 2"));
  HELIO_TRY(require(message.has_cy(), "cy", "the image's centre is (height - 1) / 2"));
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
  if (camera.aperture > 0 && !kernels::is_straight(camera.projection))
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
  const std::string_view known =
      kernels::with_kind(camera.projection, [](auto kind) { return kind.kDistortion; });
  if (known.empty())
    return fail(Code::kInvalidArgument, "distortion",
                "is for perspective and fisheye cameras; leave it out");
  if (!kernels::with_kind(camera.projection, [&](auto kind) { return kind.takes(u32(count)); }))
    return fail(Code::kInvalidArgument, "distortion",
                fmt::format("has {} numbers; give {}", count, known));
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

Expected<Camera> to_camera(const v1::Camera& message, ArraySource& source) {
  Camera camera;
  camera.projection = to_projection(message.projection());
  HELIO_TRY(read_size(message, camera));
  if (camera.projection == Projection::kRayTable)
    HELIO_TRY(read_rays(message, source, camera));
  else
    HELIO_TRY(read_intrinsics(message, camera));
  if (message.has_rays() && !camera.rays)
    return fail(Code::kInvalidArgument, "rays", "is for the projection ray_table; leave it out");
  HELIO_TRY(read_aperture(message, camera));
  HELIO_TRY(read_clip(message, camera));
  HELIO_TRY(read_distortion(message, camera));
  if (message.has_rgb_sensor())
    HELIO_TAKE(camera.rgb_sensor, to_rgb_sensor(message.rgb_sensor()), "rgb_sensor");
  if (message.has_depth_sensor())
    HELIO_TAKE(camera.depth_sensor, to_depth_sensor(message.depth_sensor(), camera),
               "depth_sensor");
  if (message.has_shutter()) HELIO_TAKE(camera.shutter, to_shutter(message.shutter()), "shutter");
  if (camera.rays) camera.shutter.rolling = camera.rays->last_time;
  return camera;
}

v1::Shutter to_proto(const Shutter& shutter) {
  v1::Shutter message;
  message.set_open(shutter.open);
  message.set_close(shutter.close);
  message.set_rolling(shutter.rolling);
  return message;
}

v1::Camera to_proto(const Camera& camera, const ArraySink& sink) {
  v1::Camera message;
  message.set_width(camera.width);
  message.set_height(camera.height);
  message.set_projection(v1::Camera::Projection(int(camera.projection) + 1));
  Shutter shutter = camera.shutter;
  if (camera.rays) {
    *message.mutable_rays() = to_proto(*camera.rays, {camera.width, camera.height}, sink);
    shutter.rolling = 0;
  } else {
    message.set_fx(camera.fx);
    message.set_fy(camera.fy);
    message.set_cx(camera.cx);
    message.set_cy(camera.cy);
  }
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
  if (shutter != Shutter{}) *message.mutable_shutter() = to_proto(shutter);
  return message;
}

}  // namespace heliograph::server
