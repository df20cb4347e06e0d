// Punctual lights as small emissive shapes, and cameras. Source: KHR_lights_punctual;
// glTF 2.0, 3.10.
//
// A convex body of uniform luminance L and area A sends Phi = pi A L lumen; its mean intensity over
// all directions is Phi / 4 pi (Cauchy). So a point light of I candela is a sphere of 4 pi I lumen.
// A one-sided disc has intensity L A = Phi / pi along its axis: a spot light of I candela is a disc
// of pi I lumen, whose cosine lobe stands for the cone. A directional light of E lux is a
// sun.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "renderer/assets/gltf/nodes.h"
#include "renderer/assets/mesh_data.h"

namespace heliograph::assets::gltf {
namespace {

constexpr float kRadius = 0.01f;      // metres, of point and spot lights
constexpr float kSunAngle = 0.0093f;  // radians, our sun's angular diameter
constexpr double kPi = std::numbers::pi;

/// A unit sphere: an icosahedron subdivided twice.
MeshData sphere() {
  MeshData mesh;
  const float a = 0.525731112f;
  const float b = 0.850650808f;
  mesh.positions = {{-a, b, 0},  {a, b, 0},  {-a, -b, 0}, {a, -b, 0}, {0, -a, b},  {0, a, b},
                    {0, -a, -b}, {0, a, -b}, {b, 0, -a},  {b, 0, a},  {-b, 0, -a}, {-b, 0, a}};
  mesh.triangles = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                    {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                    {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                    {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  for (int level = 0; level < 2; ++level) {
    std::vector<uvec3> finer;
    for (const uvec3 t : mesh.triangles) {
      const auto first = u32(mesh.positions.size());
      for (int i = 0; i < 3; ++i) {
        const vec3 middle = mesh.positions[t[i]] + mesh.positions[t[(i + 1) % 3]];
        mesh.positions.push_back(glm::normalize(middle));
      }
      finer.insert(finer.end(), {{t.x, first, first + 2},
                                 {first, t.y, first + 1},
                                 {first + 2, first + 1, t.z},
                                 {first, first + 1, first + 2}});
    }
    mesh.triangles = std::move(finer);
  }
  return mesh;
}

/// A unit disc that faces -Z.
MeshData disc() {
  constexpr u32 kCorners = 32;
  MeshData mesh;
  mesh.positions.emplace_back(0);
  for (u32 i = 0; i < kCorners; ++i) {
    const double angle = 2 * kPi * i / kCorners;
    mesh.positions.emplace_back(float(std::cos(angle)), float(std::sin(angle)), 0);
    mesh.triangles.emplace_back(0, 1 + (i + 1) % kCorners, 1 + i);
  }
  return mesh;
}

mat4x3 scaled(float size, vec3 at) {
  return {vec3(size, 0, 0), vec3(0, size, 0), vec3(0, 0, size), at};
}

}  // namespace

LightShapes add_light_shapes(const Document& document, Builder& builder) {
  LightShapes shapes;
  const auto lights = document.root().extension("KHR_lights_punctual");
  if (!lights || lights->at("lights").size() == 0) return shapes;
  PutMaterial black;
  black.parameters[std::size_t(MaterialParameter::base_color)].value = vec3(0);
  black.parameters[std::size_t(MaterialParameter::specular)].value = vec3(0);
  const auto mesh = [&](const char* name, MeshData data) {
    return builder.library(builder.claim_name(name, name),
                           finish_mesh(std::move(data), name, builder.budget));
  };
  shapes.black = builder.library(builder.claim_name("light_black", "light_black"), black);
  shapes.sphere = mesh("light_sphere", sphere());
  shapes.disc = mesh("light_disc", disc());
  return shapes;
}

void add_light(const Document& document, Builder& builder, const Value& reference, u32 node_entity,
               const LightShapes& shapes) {
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
  Light light{.color = {color[0], color[1], color[2]}, .unit = LightUnit::kLumen};
  PutEntity put;
  put.mesh = shapes.disc;
  put.pose = constant_pose(scaled(kRadius, vec3(0)));
  if (type == "point") {
    light.intensity = float(4 * kPi * intensity);
    put.mesh = shapes.sphere;
  } else if (type == "spot") {
    light.intensity = float(kPi * intensity);
    builder.warn("spot lights: the cone is approximated by a cosine lobe along its axis");
  } else if (type == "directional") {
    light.unit = LightUnit::kIlluminance;
    light.intensity = float(intensity);
    light.sun_angle = kSunAngle;
    put.mesh.reset();
    put.pose.reset();
  } else {
    refuse(value.key_where("type"), "must be point, spot or directional");
  }
  put.parent = builder.entity_ref(node_entity);
  if (put.mesh) put.materials = std::vector<Ref>{shapes.black};
  put.light = LightPatch{.light = light, .texture = {}};
  put.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = 0, .category = {}};
  put.visibility = u8(kDiffuseRay | kGlossyRay | kTransmissionRay);
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
