#include "renderer/assets/mesh_data.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace heliograph::assets {
namespace {

bool finite(const vec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

/// Unit normals; one that has no direction takes +Z, so that shading never sees a NaN.
void normalise(std::vector<vec3>& normals) {
  for (vec3& normal : normals) {
    const float length = std::hypot(normal.x, normal.y, normal.z);
    normal = length > 1e-20f ? normal / length : vec3(0, 0, 1);
  }
}

template <class T>
void check_length(const std::vector<T>& values, const MeshData& mesh, const std::string& where) {
  if (!values.empty() && values.size() != mesh.positions.size()) {
    refuse(where, fmt::format("{} values for {} vertices", values.size(), mesh.positions.size()));
  }
}

std::vector<vec3> concatenate(const std::vector<std::vector<vec3>>& targets) {
  std::vector<vec3> all;
  for (const auto& target : targets) all.insert(all.end(), target.begin(), target.end());
  return all;
}

/// Twice the polygon's area as a vector along its normal. Source: Newell's method.
glm::dvec3 newell(std::span<const vec3> polygon) {
  glm::dvec3 sum(0);
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    sum += glm::cross(glm::dvec3(polygon[i]) - glm::dvec3(polygon[0]),
                      glm::dvec3(polygon[(i + 1) % polygon.size()]) - glm::dvec3(polygon[0]));
  }
  return sum;
}

/// A polygon in its own plane, counter-clockwise.
std::vector<glm::dvec2> flatten(std::span<const vec3> polygon) {
  const glm::dvec3 n = newell(polygon);
  const glm::dvec3 size = glm::abs(n);
  const int drop = size.x > size.y && size.x > size.z ? 0 : size.y > size.z ? 1 : 2;
  const int a = (drop + 1) % 3;
  const int b = (drop + 2) % 3;
  std::vector<glm::dvec2> flat;
  for (const vec3& p : polygon) {
    flat.emplace_back(n[drop] < 0 ? p[b] : p[a], n[drop] < 0 ? p[a] : p[b]);
  }
  return flat;
}

double turn(glm::dvec2 a, glm::dvec2 b, glm::dvec2 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/// Whether corner `i` of what is left can be cut off: convex, with no other corner inside.
bool is_ear(const std::vector<glm::dvec2>& flat, const std::vector<u32>& left, std::size_t i) {
  const std::size_t count = left.size();
  const glm::dvec2 a = flat[left[(i + count - 1) % count]];
  const glm::dvec2 b = flat[left[i]];
  const glm::dvec2 c = flat[left[(i + 1) % count]];
  if (turn(a, b, c) <= 0) return false;
  for (std::size_t k = i + 2; k + 1 < i + count; ++k) {
    const glm::dvec2 p = flat[left[k % count]];
    if (turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0) return false;
  }
  return true;
}

bool is_convex(const std::vector<glm::dvec2>& flat) {
  const std::size_t count = flat.size();
  for (std::size_t i = 0; i < count; ++i) {
    if (turn(flat[i], flat[(i + 1) % count], flat[(i + 2) % count]) < 0) return false;
  }
  return true;
}

}  // namespace

PutMesh finish_mesh(MeshData mesh, const std::string& where, Budget& budget) {
  const LoadLimits& limits = budget.limits();
  const std::size_t count = mesh.positions.size();
  Budget::check(count, limits.vertices, "vertices", where);
  Budget::check(mesh.triangles.size(), limits.triangles, "triangles", where);
  if (mesh.triangles.empty()) refuse(where, "the mesh has no triangles");
  if (!std::ranges::all_of(mesh.positions, finite)) refuse(where, "a position is not finite");
  for (const uvec3& t : mesh.triangles) {
    if (t.x >= count || t.y >= count || t.z >= count) {
      refuse(where, fmt::format("an index is not below the {} vertices", count));
    }
  }
  check_length(mesh.normals, mesh, where + ".normals");
  check_length(mesh.uvs, mesh, where + ".uvs");
  check_length(mesh.uvs1, mesh, where + ".uvs1");
  check_length(mesh.colors, mesh, where + ".colors");
  check_length(mesh.tangents, mesh, where + ".tangents");
  normalise(mesh.normals);

  auto topology = std::make_shared<MeshTopology>();
  topology->vertex_count = u32(count);
  topology->triangles = ArrayOf<uvec3>(std::move(mesh.triangles));
  topology->uvs = ArrayOf<vec2>(std::move(mesh.uvs));
  topology->uvs1 = ArrayOf<vec2>(std::move(mesh.uvs1));
  topology->colors = ArrayOf<vec4>(std::move(mesh.colors));
  topology->tangents = ArrayOf<vec4>(std::move(mesh.tangents));
  topology->part_count = u32(std::max<std::size_t>(1, mesh.part_names.size()));
  if (topology->part_count > 1) topology->parts = ArrayOf<u32>(std::move(mesh.parts));
  topology->part_names = std::move(mesh.part_names);
  topology->joints = ArrayOf<glm::u16vec4>(std::move(mesh.joints));
  topology->weights = ArrayOf<vec4>(std::move(mesh.weights));
  topology->morph_count = u32(mesh.morph_positions.size());
  topology->morph_positions = ArrayOf<vec3>(concatenate(mesh.morph_positions));
  topology->morph_normals = ArrayOf<vec3>(concatenate(mesh.morph_normals));
  auto vertices = std::make_shared<VertexKeys>();
  vertices->times = {0};
  vertices->positions = ArrayOf<vec3>(std::move(mesh.positions));
  vertices->normals = ArrayOf<vec3>(std::move(mesh.normals));
  return PutMesh{.topology = std::move(topology), .vertices = std::move(vertices)};
}

void triangulate(std::span<const vec3> polygon, std::vector<uvec3>& triangles) {
  constexpr std::size_t kLargest = 4096;  // clipping is quadratic
  const auto count = u32(polygon.size());
  if (count < 3) return;
  std::vector<u32> left(count);
  std::iota(left.begin(), left.end(), 0u);
  if (count > 3 && count <= kLargest) {
    const std::vector<glm::dvec2> flat = flatten(polygon);
    const bool concave = !is_convex(flat);
    std::size_t i = 0;
    for (std::size_t tried = 0; concave && left.size() > 3 && tried < left.size();) {
      i %= left.size();
      if (!is_ear(flat, left, i)) {
        ++i, ++tried;
        continue;
      }
      const std::size_t n = left.size();
      triangles.emplace_back(left[(i + n - 1) % n], left[i], left[(i + 1) % n]);
      left.erase(left.begin() + std::ptrdiff_t(i));
      tried = 0;
    }
  }
  for (std::size_t i = 1; i + 1 < left.size(); ++i) {
    triangles.emplace_back(left[0], left[i], left[i + 1]);
  }
}

mat3 z_up_from(const std::string& up) {
  if (up == "y") return mat3(vec3(1, 0, 0), vec3(0, 0, 1), vec3(0, -1, 0));
  if (up == "x") return mat3(vec3(0, 0, 1), vec3(0, 1, 0), vec3(-1, 0, 0));
  return mat3(1);
}

void to_world_axes(MeshData& mesh, const LoadOptions& options) {
  const mat3 turn_up = z_up_from(options.up);
  const float metres = options.units > 0 ? float(options.units) : 1.0f;
  if (turn_up == mat3(1) && metres == 1.0f) return;
  for (vec3& p : mesh.positions) p = metres * (turn_up * p);
  for (vec3& n : mesh.normals) n = turn_up * n;
}

}  // namespace heliograph::assets
