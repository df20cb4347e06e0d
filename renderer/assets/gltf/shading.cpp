// Source: glTF 2.0, 3.7.2.1 (flat normals where there are none).
#include "renderer/assets/gltf/shading.h"

#include <algorithm>

namespace heliograph::assets::gltf {
namespace {

constexpr float kShortest = 1e-20f;

template <class T>
void expand(std::vector<T>& values, const std::vector<uvec3>& triangles) {
  if (values.empty()) return;
  std::vector<T> corners;
  corners.reserve(triangles.size() * 3);
  for (const uvec3& t : triangles) {
    for (int i = 0; i < 3; ++i) corners.push_back(values[t[i]]);
  }
  values = std::move(corners);
}

MeshData unshared(const MeshData& vertices, const std::vector<uvec3>& triangles, Budget& budget) {
  constexpr u64 kBytes = 3 * sizeof(vec3) + 4 * sizeof(vec4);
  budget.take(triangles.size() * 3, kBytes + 2 * sizeof(vec3) * vertices.morph_positions.size(),
              "corners");
  MeshData mesh = vertices;
  expand(mesh.positions, triangles);
  expand(mesh.normals, triangles);
  expand(mesh.tangents, triangles);
  expand(mesh.uvs, triangles);
  expand(mesh.uvs1, triangles);
  expand(mesh.colors, triangles);
  expand(mesh.joints, triangles);
  expand(mesh.weights, triangles);
  for (auto& target : mesh.morph_positions) expand(target, triangles);
  for (auto& target : mesh.morph_normals) expand(target, triangles);
  return mesh;
}

vec3 normal_of(const MeshData& mesh, const uvec3& t) {
  return glm::cross(mesh.positions[t.y] - mesh.positions[t.x],
                    mesh.positions[t.z] - mesh.positions[t.x]);
}

/// Along u, as long as the triangle is large; w: the side of v. Our v runs up, as glTF's
/// bitangents do.
vec4 tangent_of(const MeshData& mesh, const uvec3& t) {
  if (mesh.uvs.empty()) return {0, 0, 0, 1};
  const vec2 ab = mesh.uvs[t.y] - mesh.uvs[t.x];
  const vec2 ac = mesh.uvs[t.z] - mesh.uvs[t.x];
  const float turn = ab.x * ac.y - ab.y * ac.x < 0 ? -1.0f : 1.0f;
  const vec3 along = (mesh.positions[t.y] - mesh.positions[t.x]) * ac.y -
                     (mesh.positions[t.z] - mesh.positions[t.x]) * ab.y;
  return {along * turn, turn};
}

vec4 unit_tangent(const vec4& tangent) {
  const float length = glm::length(vec3(tangent));
  return length > kShortest ? vec4(vec3(tangent) / length, tangent.w) : vec4(0, 0, 0, 1);
}

uvec3 corners_of(std::size_t triangle) {
  const u32 first = u32(3 * triangle);
  return {first, first + 1, first + 2};
}

}  // namespace

MeshData flat_shaded(const MeshData& vertices, const std::vector<uvec3>& triangles,
                     Budget& budget) {
  MeshData mesh = unshared(vertices, triangles, budget);
  mesh.morph_normals.clear();
  mesh.tangents.clear();  // they belong to the smooth normals that are not there
  mesh.normals.clear();
  for (std::size_t i = 0; i < triangles.size(); ++i)
    mesh.normals.insert(mesh.normals.end(), 3, normal_of(mesh, corners_of(i)));
  return mesh;
}

MeshData with_own_tangents(const MeshData& vertices, const std::vector<uvec3>& triangles,
                           Budget& budget) {
  MeshData mesh = unshared(vertices, triangles, budget);
  mesh.tangents.clear();
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    mesh.tangents.insert(mesh.tangents.end(), 3, unit_tangent(tangent_of(mesh, corners_of(i))));
  }
  return mesh;
}

std::size_t mend_directions(MeshData& mesh) {
  const auto lost = [](const auto& v) { return !(glm::length(vec3(v)) > kShortest); };
  const auto lost_normals = std::size_t(std::ranges::count_if(mesh.normals, lost));
  const bool lost_tangents = std::ranges::any_of(mesh.tangents, lost);
  if (lost_normals == 0 && !lost_tangents) return 0;
  std::vector<vec3> normals(mesh.normals.size(), vec3(0));
  std::vector<vec4> tangents(mesh.tangents.size(), vec4(0));
  for (const uvec3& t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) {
      if (!normals.empty()) normals[t[i]] += normal_of(mesh, t);
      if (!tangents.empty()) tangents[t[i]] += tangent_of(mesh, t);
    }
  }
  for (std::size_t v = 0; v < normals.size(); ++v) {
    if (lost(mesh.normals[v])) mesh.normals[v] = normals[v];
  }
  for (std::size_t v = 0; v < tangents.size(); ++v) {
    if (!lost(mesh.tangents[v])) continue;
    tangents[v].w = tangents[v].w < 0 ? -1.0f : 1.0f;
    mesh.tangents[v] = unit_tangent(tangents[v]);
  }
  return lost_normals;
}

}  // namespace heliograph::assets::gltf
