// Punctual lights and luminaires as small shapes of light, and cameras. Source:
// KHR_lights_punctual; EXT_lights_ies; glTF 2.0, 3.10.
//
// A point light is a sphere of its candela, a spot light one with its cone, a luminaire one with
// its profile, a directional light a sun.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "renderer/assets/gltf/nodes.h"
#include "renderer/assets/picture.h"
#include "renderer/scene/invertible.h"

namespace heliograph::assets::gltf {
namespace {

constexpr float kRadius = 0.01f;      // metres, of point and spot lights
constexpr float kSunAngle = 0.0093f;  // radians, our sun's angular diameter
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

Light small_sphere() { return {.shape = LightShape::kSphere, .radius = kRadius}; }

/// The object that an index names in a list of the document's own extension.
Value listed_light(const Document& document, const std::string& extension, const Value& index) {
  const auto found = document.root().extension(extension);
  if (!found) refuse(index.where(), fmt::format("the document defines no {} lights", extension));
  const Value list = found->at("lights");
  return list[index.index(list.size())];
}

void read_color(const Value& value, Light& light, const std::string& strength) {
  const auto color = value.numbers<3>("color", {1, 1, 1});
  const double intensity = value.number(strength, 1);
  if (intensity < 0 || *std::ranges::min_element(color) < 0)
    refuse(value.where(), fmt::format("{} and color must be 0 or more", strength));
  light.color = {color[0], color[1], color[2]};
  light.intensity = float(intensity);
}

void add_light(Builder& builder, LightPatch light, const std::string& name,
               const NodeLights& lights) {
  PutEntity put;
  put.parent = builder.entity_ref(lights.entity);
  if (lights.node_from_light != mat4x3(1)) put.pose = constant_pose(lights.node_from_light);
  put.light = std::move(light);
  put.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = 0, .category = {}};
  put.visibility = u8(kAllRays & ~kCameraRay & ~kShadowRay);
  builder.entity(name, std::move(put));
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
  add_light(builder, {.light = light, .texture = {}}, name, lights);
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

mat4x3 unscaled(const mat4x3& scene_from_node) {
  const mat3 linear(scene_from_node);
  if (!invertible(scene_from_node)) return mat4x3(1);
  const vec3 z = glm::normalize(linear[2]);
  const vec3 x = glm::normalize(linear[0] - z * glm::dot(linear[0], z));
  const mat3 turned(x, glm::cross(z, x), z);
  const auto pose = mat4x3(glm::inverse(linear) * turned);
  const bool same = glm::all(glm::lessThan(glm::abs(linear[0] - x), vec3(1e-5f))) &&
                    glm::all(glm::lessThan(glm::abs(linear[1] - turned[1]), vec3(1e-5f))) &&
                    glm::all(glm::lessThan(glm::abs(linear[2] - z), vec3(1e-5f)));
  return same || !invertible(pose) ? mat4x3(1) : pose;
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
    add_light(builder, {.light = light, .texture = {}, .profile = *profile},
              builder.claim_name("luminaire", "luminaire"), lights);
  }
}

Camera read_camera(const Value& value) {
  constexpr double kHeight = 1080;
  constexpr double kWidest = 65536;
  const std::string type = value.at("type").text();
  Camera camera{.height = u32(kHeight)};
  const auto set_width = [&](double aspect) {
    camera.width = u32(std::clamp(std::round(kHeight * aspect), 1.0, kWidest));
    camera.cx = (camera.width - 1) / 2.0;
    camera.cy = (camera.height - 1) / 2.0;
  };
  if (type == "perspective") {
    const Value lens = value.at("perspective");
    const double yfov = lens.at("yfov").number();
    const double aspect = lens.number("aspectRatio", 16.0 / 9.0);
    if (!(yfov > 0 && yfov < kPi)) refuse(lens.key_where("yfov"), "must be between 0 and pi");
    if (!(aspect > 0)) refuse(lens.key_where("aspectRatio"), "must be positive");
    set_width(aspect);
    camera.fy = 0.5 * camera.height / std::tan(0.5 * yfov);
    camera.fx = 0.5 * camera.width / (aspect * std::tan(0.5 * yfov));
  } else if (type == "orthographic") {
    const Value lens = value.at("orthographic");
    const double xmag = std::abs(lens.at("xmag").number());
    const double ymag = std::abs(lens.at("ymag").number());
    if (!(xmag > 0 && ymag > 0)) refuse(lens.where(), "xmag and ymag must not be 0");
    set_width(xmag / ymag);
    camera.projection = Projection::kOrthographic;
    camera.fx = camera.width / (2 * xmag);
    camera.fy = camera.height / (2 * ymag);
  } else {
    refuse(value.key_where("type"), "must be perspective or orthographic");
  }
  return camera;
}

}  // namespace heliograph::assets::gltf
