// What an entity carries itself: label, light, skin.
#include <fmt/format.h>

#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr std::array kUnits{
    LightUnit::kRadiance, LightUnit::kRadiance,   LightUnit::kPower,       LightUnit::kLuminance,
    LightUnit::kLumen,    LightUnit::kIrradiance, LightUnit::kIlluminance,
};
static_assert(kUnits.size() == v1::Light::Unit_ARRAYSIZE);
constexpr Range kBrightness{0, 1e15};
constexpr Range kExposure{-64, 64};
constexpr Range kKelvin{1000, 40000};
constexpr Range kSunAngle{1e-4, 3.14};
constexpr u32 kLargestLabel = 0xfffffffeu;

/// Whether a use of a texture names one; id 0 is nothing.
bool binds(const v1::TextureUse& use) {
  const v1::Ref& texture = use.texture();
  return texture.has_name() || texture.has_created_by_edit() || texture.id() != 0;
}

/// What a sun and a mesh's light do not share.
Status check_sun(const v1::Light& message, LightUnit unit) {
  const bool sun = message.sun_angle() != 0;
  if ((unit == LightUnit::kIrradiance || unit == LightUnit::kIlluminance) && !sun)
    return fail(Code::kInvalidArgument, "unit",
                "is for suns; give a sun_angle, or the radiance, power, luminance or lumen");
  if (!sun) return {};
  if (unit == LightUnit::kPower || unit == LightUnit::kLumen)
    return fail(Code::kInvalidArgument, "unit",
                "is for meshes; a sun has a radiance, luminance, irradiance or illuminance");
  if (message.two_sided())
    return fail(Code::kInvalidArgument, "two_sided", "is for meshes; leave it out for a sun");
  if (binds(message.texture()))
    return fail(Code::kInvalidArgument, "texture", "is for meshes; leave it out for a sun");
  return {};
}

}  // namespace

Expected<LabelPatch> to_label(const v1::Label& message) {
  LabelPatch patch;
  if (message.has_value()) {
    patch.kind = LabelPatch::Kind::kValue;
    HELIO_TAKE(patch.value, in_range(message.value(), {0, double(kLargestLabel)}), "value");
  } else if (message.has_auto_()) {
    if (!message.auto_())
      return fail(
          Code::kInvalidArgument, "auto",
          "is false; set it to true, give value 0 to opt out, or leave both out to inherit");
    patch.kind = LabelPatch::Kind::kAuto;
  }
  patch.group = message.group();
  if (message.has_category()) patch.category = message.category();
  patch.part = message.part();
  return patch;
}

v1::Label to_proto(const LabelPatch& patch) {
  v1::Label message;
  if (patch.kind == LabelPatch::Kind::kValue) message.set_value(patch.value);
  if (patch.kind == LabelPatch::Kind::kAuto) message.set_auto_(true);
  message.set_group(patch.group);
  if (patch.category) message.set_category(*patch.category);
  message.set_part(patch.part);
  return message;
}

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
  const double peak = std::max({light.color.x, light.color.y, light.color.z});
  HELIO_CHECK(in_range(peak * light.intensity * std::exp2(light.exposure), {0, 1e30}), "intensity");
  if (message.has_texture())
    HELIO_TAKE(patch.texture, to_texture_use(message.texture(), source, false), "texture");
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
  if (!std::holds_alternative<std::monostate>(patch.texture.texture)) {
    *message.mutable_texture() = to_proto(patch.texture, sink);
    message.mutable_texture()->clear_channel();
  }
  return message;
}

Expected<SkinPatch> to_skin(const v1::Skin& message, ArraySource& source) {
  SkinPatch patch;
  if (message.joints_size() < 1 || message.joints_size() > 65536)
    return fail(Code::kInvalidArgument, "joints",
                fmt::format("has {} entities; give 1 to 65536", message.joints_size()));
  HELIO_TAKE(patch.joints, to_refs(message.joints()), "joints");
  if (!message.has_inverse_binds()) {
    patch.inverse_binds.assign(patch.joints.size(), mat4x3(1));
    return patch;
  }
  const Dims dims{{"J", patch.joints.size()}, kFour, kFour};
  HELIO_TAKE(patch.inverse_binds, read_affine(message.inverse_binds(), source, dims),
             "inverse_binds");
  return patch;
}

v1::Skin to_proto(const SkinPatch& patch, const ArraySink& sink) {
  v1::Skin message;
  for (const Ref& joint : patch.joints) *message.add_joints() = to_proto(joint);
  *message.mutable_inverse_binds() = to_array(patch.inverse_binds, false, sink);
  return message;
}

}  // namespace heliograph::server
