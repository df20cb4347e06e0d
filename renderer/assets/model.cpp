#include "renderer/assets/model.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>

#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

void to_world(Model& model, const LoadOptions& options) {
  const mat3 turn_up = z_up_from(options.up);
  const double metres = options.units > 0 ? options.units : 1;
  if (turn_up == mat3(1) && metres == 1) return;
  for (glm::dvec3& p : model.positions) p = metres * (glm::dmat3(turn_up) * p);
  for (vec3& n : model.mesh.normals) n = turn_up * n;
}

}  // namespace

void put_model(Builder& builder, Model model) {
  to_world(model, builder.options);
  if (!model.mesh.colors.empty()) White().fill(model.materials, builder);
  Centred placed = centred(model.positions, builder);
  model.mesh.positions = std::move(placed.positions);
  const std::string stem = stem_of(builder.bundle.model().path);
  PutEntity shown;
  shown.mesh = builder.library(builder.claim_name(stem, "mesh"),
                               finish_mesh(std::move(model.mesh), model.where, builder.budget).put);
  if (!std::ranges::all_of(model.materials, is_nothing))
    shown.materials = std::move(model.materials);
  std::string name;
  if (placed.centre != glm::dvec3(0)) {
    shown.parent = builder.entity_ref(builder.entity("", PutEntity{}));
    shown.pose = constant_pose(mat4x3(glm::translate(mat4(1), vec3(placed.centre))));
    name = builder.claim_name("about_centre", "node");
  }
  builder.entity(name, std::move(shown));
}

Centred centred(std::span<const glm::dvec3> positions, Builder& builder) {
  constexpr double kStep = 0x1p-24, kBearable = 1e-5;  // f32's rounding, as a share
  Centred out;
  glm::dvec3 low(0), high(0);
  if (!positions.empty()) low = high = positions.front();
  for (const glm::dvec3& p : positions) low = glm::min(low, p), high = glm::max(high, p);
  const glm::dvec3 farthest = glm::max(glm::abs(low), glm::abs(high));
  const double loss = kStep * std::max({farthest.x, farthest.y, farthest.z});
  const double size = glm::length(high - low);
  if (size > 0 && loss > kBearable * size) {
    out.centre = 0.5 * (low + high);
    builder.warn(fmt::format(
        "a mesh of {:.3g} m lies at ({:.3f}, {:.3f}, {:.3f}) m, where f32 has steps of {:.2g} m: "
        "its vertices are kept about that place, which is the pose of its entity; take it from the "
        "asset's transform, so that the model comes to the origin",
        size, out.centre.x, out.centre.y, out.centre.z, 2 * loss));
  }
  out.positions.reserve(positions.size());
  for (const glm::dvec3& p : positions) out.positions.emplace_back(p - out.centre);
  return out;
}

void White::fill(std::vector<Ref>& materials, Builder& builder) {
  if (materials.empty()) materials.emplace_back();
  if (std::ranges::none_of(materials, is_nothing)) return;
  if (is_nothing(made_)) {
    PutMaterial white;
    white.parameters[std::size_t(MaterialParameter::base_color)].value = vec3(1);
    made_ = builder.library(builder.claim_name("vertex_colors", "vertex_colors"), white);
  }
  std::ranges::replace_if(materials, is_nothing, made_);
}

bool clamp_colors(std::vector<vec4>& colors, Builder& builder) {
  constexpr float kScaled = 2, kBytes = 255;
  float most = 0;
  for (const vec4& color : colors) most = std::max({most, color.x, color.y, color.z});
  const bool bytes = most > kScaled && most <= kBytes;
  if (bytes) builder.warn("colours of vertices go up to 255 and are divided by that");
  if (!bytes && most > 1) builder.warn("colours of vertices above 1 are taken as 1");
  const float scale = bytes ? 1 / kBytes : 1;
  for (vec4& color : colors)
    color = vec4(glm::clamp(scale * vec3(color), 0.0f, 1.0f), std::clamp(color.w, 0.0f, 1.0f));
  return bytes;
}

void make_linear(std::vector<vec4>& colors) {
  for (vec4& color : colors)
    for (int i = 0; i < 3; ++i) color[i] = linear_from_srgb(color[i]);
}

}  // namespace heliograph::assets
