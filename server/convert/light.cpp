// Lights of entities.
#include <fmt/format.h>

#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr std::array kUnits{
    LightUnit::kRadiance, LightUnit::kRadiance,     LightUnit::kPower,       LightUnit::kLuminance,
    LightUnit::kLumen,    LightUnit::kIrradiance,   LightUnit::kIlluminance, LightUnit::kIntensity,
    LightUnit::kCandela,  LightUnit::kProfileScale,
};
static_assert(kUnits.size() == v1::Light::Unit_ARRAYSIZE);
constexpr std::array kShapes{LightShape::kMesh, LightShape::kMesh,
#define HELIO_SHAPE(name, primitive) LightShape::name,
                             HELIO_LIGHT_SHAPES(HELIO_SHAPE)
#undef HELIO_SHAPE
};
static_assert(kShapes.size() == v1::Light::Shape_ARRAYSIZE);

constexpr Range kBrightness{0, 1e15};
constexpr Range kExposure{-64, 64};
constexpr Range kKelvin{1000, 40000};
constexpr Range kSunAngle{1e-4, 3.14};
constexpr Range kSize{1e-6, 1e6};
constexpr Range kOuterAngle{1e-3, 1.5708};

/// Returns true when a reference names an object; id 0 is none.
bool binds(const v1::Ref& ref) {
  return ref.has_name() || ref.has_created_by_edit() || ref.id() != 0;
}

/// Refuses a field that is set where it has no meaning.
Status only(bool allowed, bool set, const char* field, const char* remedy) {
  if (allowed || !set) return {};
  return fail(Code::kInvalidArgument, field, remedy);
}

/// Checks fields that apply to suns only, or to other lights only.
Status check_sun(const v1::Light& message, LightUnit unit) {
  const bool sun = message.sun_angle() != 0;
  const bool of_sun = unit == LightUnit::kIrradiance || unit == LightUnit::kIlluminance;
  HELIO_TRY(only(sun, of_sun, "unit",
                 "is for suns; give a sun_angle, or the radiance, power, luminance or lumen"));
  const bool of_area = unit == LightUnit::kPower || unit == LightUnit::kLumen;
  HELIO_TRY(only(!sun, of_area, "unit",
                 "is for meshes and shapes; a sun has a radiance, luminance, irradiance or "
                 "illuminance"));
  const char* remedy = "is for meshes and shapes; leave it out for a sun";
  HELIO_TRY(only(!sun, message.two_sided(), "two_sided", remedy));
  HELIO_TRY(only(!sun, binds(message.texture().texture()), "texture", remedy));
  return only(!sun, from_enum(kShapes, message.shape()) != LightShape::kMesh, "shape",
              "is infinitely far away as a sun; leave out sun_angle or shape");
}

/// Checks fields that apply to shapes, or to one kind of shape, only.
Status check_shape(const v1::Light& message, LightUnit unit) {
  const LightShape shape = from_enum(kShapes, message.shape());
  const bool any = shape != LightShape::kMesh, flat = shape == LightShape::kRectangle;
  HELIO_TRY(only(any, unit == LightUnit::kIntensity || unit == LightUnit::kCandela, "unit",
                 "is for shapes; give a shape, or the radiance, power, luminance or lumen"));
  HELIO_TRY(only(any && !flat, message.has_radius(), "radius", "is for spheres and discs"));
  HELIO_TRY(only(flat, message.has_width(), "width", "is for rectangles"));
  HELIO_TRY(only(flat, message.has_height(), "height", "is for rectangles"));
  HELIO_TRY(only(any, message.outer_cone_angle() != 0, "outer_cone_angle",
                 "is for shapes; give the light a shape, such as a small sphere"));
  return only(message.outer_cone_angle() != 0, message.inner_cone_angle() != 0, "inner_cone_angle",
              "is within a cone; give its outer_cone_angle");
}

/// Checks units and fields that apply only with, or only without, a profile.
Status check_profile(const v1::Light& message, LightUnit unit) {
  const bool profile = binds(message.profile());
  HELIO_TRY(only(profile, unit == LightUnit::kProfileScale, "unit",
                 "is for lights with a profile; give one, or the candela"));
  const bool shape = from_enum(kShapes, message.shape()) != LightShape::kMesh;
  HELIO_TRY(only(shape, profile, "profile",
                 "is for shapes; give the light a shape, such as a small sphere"));
  HELIO_TRY(only(!profile, unit == LightUnit::kRadiance || unit == LightUnit::kLuminance, "unit",
                 "differs by direction with a profile; give the profile_scale, candela, lumen, "
                 "intensity or power"));
  return only(!profile, message.outer_cone_angle() != 0, "outer_cone_angle",
              "is for lights without a profile; leave one of them out");
}

Status read_shape(const v1::Light& message, Light& light) {
  light.shape = from_enum(kShapes, message.shape());
  if (message.has_radius()) HELIO_TAKE(light.radius, in_range(message.radius(), kSize), "radius");
  if (message.has_width()) HELIO_TAKE(light.width, in_range(message.width(), kSize), "width");
  if (message.has_height()) HELIO_TAKE(light.height, in_range(message.height(), kSize), "height");
  if (message.outer_cone_angle() == 0) return {};
  HELIO_TAKE(light.outer_cone_angle, in_range(message.outer_cone_angle(), kOuterAngle),
             "outer_cone_angle");
  HELIO_TAKE(light.inner_cone_angle,
             in_range(message.inner_cone_angle(), {0, double(light.outer_cone_angle)}),
             "inner_cone_angle");
  return {};
}

void write_shape(const Light& light, v1::Light& message) {
  if (light.shape == LightShape::kMesh) return;
  message.set_shape(to_enum<v1::Light::Shape>(kShapes, light.shape));
  if (light.shape == LightShape::kRectangle) {
    message.set_width(light.width);
    message.set_height(light.height);
  } else {
    message.set_radius(light.radius);
  }
  if (light.outer_cone_angle == 0) return;
  message.set_inner_cone_angle(light.inner_cone_angle);
  message.set_outer_cone_angle(light.outer_cone_angle);
}

}  // namespace

Expected<LightPatch> to_light(const v1::Light& message, ArraySource& source) {
  LightPatch patch;
  Light& light = patch.light;
  if (message.has_color()) HELIO_TAKE(light.color, to_vec3(message.color(), kBrightness), "color");
  if (message.has_intensity())
    HELIO_TAKE(light.intensity, in_range(message.intensity(), kBrightness), "intensity");
  light.unit = from_enum(kUnits, message.unit());
  HELIO_TAKE(light.exposure, in_range(message.exposure(), kExposure), "exposure");
  if (message.temperature() != 0)
    HELIO_TAKE(light.temperature, in_range(message.temperature(), kKelvin), "temperature");
  light.two_sided = message.two_sided();
  if (message.sun_angle() != 0)
    HELIO_TAKE(light.sun_angle, in_range(message.sun_angle(), kSunAngle), "sun_angle");
  HELIO_TRY(check_sun(message, light.unit));
  HELIO_TRY(check_shape(message, light.unit));
  HELIO_TRY(check_profile(message, light.unit));
  HELIO_TRY(read_shape(message, light));
  const double peak = std::max({light.color.x, light.color.y, light.color.z});
  HELIO_CHECK(in_range(peak * light.intensity * std::exp2(light.exposure), {0, 1e30}), "intensity");
  if (message.has_texture())
    HELIO_TAKE(patch.texture, to_texture_use(message.texture(), source, false), "texture");
  if (message.has_profile()) HELIO_TAKE(patch.profile, to_ref(message.profile()), "profile");
  return patch;
}

v1::Light to_proto(const LightPatch& patch, const ArraySink& sink) {
  v1::Light message;
  *message.mutable_color() = to_proto(patch.light.color);
  message.set_intensity(patch.light.intensity);
  message.set_unit(to_enum<v1::Light::Unit>(kUnits, patch.light.unit));
  message.set_exposure(patch.light.exposure);
  message.set_temperature(patch.light.temperature);
  message.set_two_sided(patch.light.two_sided);
  if (patch.light.sun_angle > 0) message.set_sun_angle(patch.light.sun_angle);
  write_shape(patch.light, message);
  if (!std::holds_alternative<std::monostate>(patch.texture.texture)) {
    *message.mutable_texture() = to_proto(patch.texture, sink);
    message.mutable_texture()->clear_channel();
  }
  if (!std::holds_alternative<std::monostate>(patch.profile))
    *message.mutable_profile() = to_proto(patch.profile);
  return message;
}

}  // namespace heliograph::server
