// Punctual lights and luminaires as small shapes of light, and cameras. Source:
// KHR_lights_punctual; EXT_lights_ies; glTF 2.0, 3.10.
//
// A point light is a sphere of its candela, a spot light one with its cone, a luminaire one with
// its profile, a directional light a sun.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "renderer/assets/gltf/nodes.h"
#include "renderer/assets/lamps.h"
#include "renderer/assets/picture.h"

namespace heliograph::assets::gltf {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr const char* kPunctual = "KHR_lights_punctual";
constexpr const char* kProfiles = "EXT_lights_ies";

/// The cone of a spot light.
void read_cone(const Value& value, Light& light) {
  const double outer = value.number("outerConeAngle", kPi / 4);
  const double inner = value.number("innerConeAngle", 0);
  if (!(inner >= 0 && inner < outer && outer <= 0.50001 * kPi)) {
    refuse(value.where(), "the angles need 0 <= innerConeAngle < outerConeAngle <= pi / 2");
  }
  light.outer_cone_angle = float(std::clamp(outer, 1e-3, kPi / 2));
  light.inner_cone_angle = std::min(float(inner), light.outer_cone_angle);
}

/// The object that an index names in a list of the document's own extension.
Value listed_light(const Document& document, const std::string& extension, const Value& index) {
  const auto found = document.root().extension(extension);
  if (!found) refuse(index.where(), fmt::format("the document defines no {} lights", extension));
  const Value list = found->at("lights");
  return list[index.index(list.size())];
}

void read_color(const Value& value, Light& light, const std::string& strength) {
  light.color = value.numbers("color", vec3(1));
  const double intensity = value.number(strength, 1);
  if (intensity < 0 || glm::any(glm::lessThan(light.color, vec3(0))))
    refuse(value.where(), fmt::format("{} and color must be 0 or more", strength));
  light.intensity = float(intensity);
}

void add_punctual(Builder& builder, const Value& value, const NodeLights& lights) {
  const std::string type = value.at("type").text();
  Light light;
  if (type == "directional") {
    light.unit = LightUnit::kIlluminance;
    light.sun_angle = kSunAngle;
  } else if (type == "point" || type == "spot") {
    light = small_sphere();
    light.unit = LightUnit::kCandela;
    if (type == "spot") read_cone(value.at("spot"), light);
  } else {
    refuse(value.key_where("type"), "must be point, spot or directional");
  }
  read_color(value, light, "intensity");
  const std::string name = builder.claim_name(value.text("name", ""), type + "_light");
  put_light(builder, {.light = light, .texture = {}}, name, lights.below);
}

}  // namespace

std::vector<std::optional<Ref>> load_profiles(Document& document, Builder& builder) {
  std::vector<std::optional<Ref>> profiles;
  const auto extension = document.root().extension(kProfiles);
  if (!extension) return profiles;
  const Value lights = extension->at("lights");
  for (std::size_t i = 0; i < lights.size(); ++i) {
    const Value value = lights[i];
    if (document.is_lacking(value)) {
      profiles.emplace_back();
      continue;
    }
    const auto file = document.linked_bytes(value);
    if (!builder.complete()) continue;
    Picture picture = decode_ies({file->bytes, value.where(), builder.budget});
    for (const std::string& warning : picture.warnings) builder.warn(warning);
    PutTexture put{.image = std::make_shared<const ImageData>(std::move(picture.image))};
    profiles.emplace_back(builder.library(
        builder.claim_name(value.text("name", ""), fmt::format("profile_{}", i)), std::move(put)));
  }
  return profiles;
}

bool has_lights(const Value& node) {
  return node.extension(kPunctual).has_value() || node.extension(kProfiles).has_value();
}

void add_lights(const Document& document, Builder& builder,
                const std::vector<std::optional<Ref>>& profiles, const NodeLights& lights) {
  if (const auto punctual = lights.node.extension(kPunctual))
    add_punctual(builder, listed_light(document, kPunctual, punctual->at("light")), lights);
  if (const auto luminaire = lights.node.extension(kProfiles)) {
    const auto& profile = profiles[luminaire->at("light").index(profiles.size())];
    if (!profile) return;
    Light light = small_sphere();
    light.unit = LightUnit::kProfileScale;
    read_color(*luminaire, light, "multiplier");
    put_light(builder, {.light = light, .texture = {}, .profile = *profile},
              builder.claim_name("luminaire", "luminaire"), lights.below);
  }
}

Camera read_camera(const Value& value) {
  const std::string type = value.at("type").text();
  if (type == "perspective") {
    const Value lens = value.at("perspective");
    const double yfov = lens.at("yfov").number();
    const double aspect = lens.number("aspectRatio", 16.0 / 9.0);
    if (!(yfov > 0 && yfov < kPi)) refuse(lens.key_where("yfov"), "must be between 0 and pi");
    if (!(aspect > 0)) refuse(lens.key_where("aspectRatio"), "must be positive");
    return perspective_camera(yfov, aspect);
  }
  if (type == "orthographic") {
    const Value lens = value.at("orthographic");
    const double xmag = std::abs(lens.at("xmag").number());
    const double ymag = std::abs(lens.at("ymag").number());
    if (!(xmag > 0 && ymag > 0)) refuse(lens.where(), "xmag and ymag must not be 0");
    return orthographic_camera(xmag, ymag);
  }
  refuse(value.key_where("type"), "must be perspective or orthographic");
}

}  // namespace heliograph::assets::gltf
