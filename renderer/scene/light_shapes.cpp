// The meshes of light shapes.
#include "renderer/scene/light_shapes.h"

#include <array>
#include <glm/glm.hpp>

namespace heliograph {
namespace {

Mesh unit_mesh(LightShape shape, std::vector<vec3> positions, std::vector<vec2> uvs) {
  auto topology = std::make_shared<MeshTopology>();
  topology->shape = shape;
  topology->vertex_count = u32(positions.size());
  std::vector<uvec3> triangles{{0, 1, 2}};
  if (positions.size() == 4) triangles.emplace_back(2, 1, 3);
  topology->triangles = ArrayOf(std::move(triangles));
  topology->uvs = ArrayOf(std::move(uvs));
  auto vertices = std::make_shared<VertexKeys>();
  vertices->times = {0};
  vertices->positions = ArrayOf(std::move(positions));
  return {std::move(topology), std::move(vertices)};
}

}  // namespace

const Mesh* shape_mesh(LightShape shape) {
  using enum LightShape;
  // Seen from the front with +Y up, texture space has its origin at the lower left.
  static const std::array kMeshes{
      unit_mesh(kSphere, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{0, 0}, {1, 0}, {0, 1}}),
      unit_mesh(kDisc, {{1, -1, 0}, {-1, -1, 0}, {1, 1, 0}}, {{0, 0}, {1, 0}, {0, 1}}),
      unit_mesh(kRectangle, {{.5f, -.5f, 0}, {-.5f, -.5f, 0}, {.5f, .5f, 0}, {-.5f, .5f, 0}},
                {{0, 0}, {1, 0}, {0, 1}, {1, 1}})};
  return &kMeshes[std::size_t(shape) - 1];
}

bool has_light_shape(const Entity& entity) {
  return entity.light && entity.light->shape != LightShape::kMesh;
}

bool emits(const Light& light) {
  return light.intensity > 0 && glm::any(glm::greaterThan(light.color, vec3(0)));
}

const Mesh* shown_mesh(const Snapshot& snapshot, const Entity& entity) {
  if (has_light_shape(entity)) return shape_mesh(entity.light->shape);
  const Shared<Mesh>* row = snapshot.find(entity.mesh);
  return row ? row->value.get() : nullptr;
}

vec3 shown_scale(const Entity& entity) {
  if (!has_light_shape(entity)) return vec3(1);
  const Light& light = *entity.light;
  return light.shape == LightShape::kRectangle ? vec3(light.width, light.height, 1)
                                               : vec3(light.radius);
}

}  // namespace heliograph
