// The meshes of light shapes.
#include "renderer/scene/light_shapes.h"

#include <array>
#include <cmath>
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

/// Area of the unit sphere under a linear map that is not similar: the mean of |cof(M) n| over 4
/// pi.
double ellipsoid_area(const mat3& m) {
  constexpr int kDirections = 4096;  // of a spherical Fibonacci lattice; errors below 1e-4
  const mat3 cofactor(glm::cross(m[1], m[2]), glm::cross(m[2], m[0]), glm::cross(m[0], m[1]));
  double sum = 0;
  for (int i = 0; i < kDirections; ++i) {
    const double z = 1 - (2 * i + 1.0) / kDirections, r = std::sqrt(1 - z * z);
    const double phi = i * M_PI * (3 - std::sqrt(5.0));
    const vec3 n(r * std::cos(phi), r * std::sin(phi), z);
    sum += double(glm::length(cofactor * n));
  }
  return 4 * M_PI * sum / kDirections;
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

std::optional<double> area_scale(const mat4x3& m) {
  const vec3 x = m[0], y = m[1], z = m[2];
  const float s = glm::dot(x, x), tolerance = 1e-4f * s;
  const bool similar = std::abs(glm::dot(y, y) - s) < tolerance &&
                       std::abs(glm::dot(z, z) - s) < tolerance &&
                       std::abs(glm::dot(x, y)) < tolerance &&
                       std::abs(glm::dot(x, z)) < tolerance && std::abs(glm::dot(y, z)) < tolerance;
  return similar ? std::optional<double>(s) : std::nullopt;
}

kernels::Shape primitive_of(LightShape shape) {
  switch (shape) {
#define HELIO_SHAPE(name, primitive) \
  case LightShape::name:             \
    return kernels::Shape::primitive;
    HELIO_LIGHT_SHAPES(HELIO_SHAPE)
#undef HELIO_SHAPE
    case LightShape::kMesh:
      break;
  }
  return kernels::Shape::kTriangles;
}

double shape_area(LightShape shape, const mat4x3& m) {
  const double parallelogram = double(glm::length(glm::cross(m[0], m[1])));
  switch (shape) {
    case LightShape::kSphere:
      if (const auto scale = area_scale(m)) return 4 * M_PI * *scale;
      return ellipsoid_area(mat3(m));
    case LightShape::kDisc:
      return M_PI * parallelogram;
    case LightShape::kRectangle:
      return parallelogram;
    case LightShape::kMesh:
      break;
  }
  return 0;  // parts have areas: part_area()
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
