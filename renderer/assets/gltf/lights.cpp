// Punctual lights as small shapes of light, and cameras. Source: KHR_lights_punctual;
// glTF 2.0, 3.10.
//
// A point light is a sphere of its candela, a spot light one with its cone, a directional light a
// sun.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "renderer/assets/gltf/nodes.h"

namespace heliograph::assets::gltf {
namespace {

constexpr float kRadius = 0.01f;      // metres, of point and spot lights
constexpr float kSunAngle = 0.0093f;  // radians, our sun's angular diameter
constexpr double kPi = std::numbers::pi;

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

}  // namespace

void add_light(const Document& document, Builder& builder, const Value& reference,
               u32 node_entity) {
  const auto extension = document.root().extension("KHR_lights_punctual");
  if (!extension) refuse(reference.where(), "the document defines no KHR_lights_punctual lights");
  const Value list = extension->at("lights");
  const Value value = list[reference.index(list.size())];
  const std::string type = value.at("type").text();
  const auto color = value.numbers<3>("color", {1, 1, 1});
  const double intensity = value.number("intensity", 1);
  if (intensity < 0 || *std::ranges::min_element(color) < 0) {
    refuse(value.where(), "intensity and color must be 0 or more");
  }
  Light light{.color = {color[0], color[1], color[2]}, .intensity = float(intensity)};
  if (type == "directional") {
    light.unit = LightUnit::kIlluminance;
    light.sun_angle = kSunAngle;
  } else if (type == "point" || type == "spot") {
    light.unit = LightUnit::kCandela;
    light.shape = LightShape::kSphere;
    light.radius = kRadius;
    if (type == "spot") read_cone(value.at("spot"), light);
  } else {
    refuse(value.key_where("type"), "must be point, spot or directional");
  }
  PutEntity put;
  put.parent = builder.entity_ref(node_entity);
  put.light = LightPatch{.light = light, .texture = {}};
  put.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = 0, .category = {}};
  put.visibility = u8(kAllRays & ~kCameraRay & ~kShadowRay);
  builder.entity(builder.claim_name(value.text("name", ""), type + "_light"), std::move(put));
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
