// Source: glTF 2.0, 3.7.2.1 (flat normals where there are none).
#include "renderer/assets/gltf/shading.h"

#include <algorithm>

namespace heliograph::assets::gltf {
namespace {

MeshData unshared(const MeshData& vertices, const std::vector<uvec3>& triangles, Budget& budget) {
  MeshData mesh = vertices;
  for_each_vertex_array(mesh, [&]<class T>(std::vector<T>& values) {
    if (values.empty()) return;
    budget.take(triangles.size() * 3, sizeof(T), "corners");
    std::vector<T> corners;
    corners.reserve(triangles.size() * 3);
    for (const uvec3& t : triangles) {
      for (int i = 0; i < 3; ++i) corners.push_back(values[t[i]]);
    }
    values = std::move(corners);
  });
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
  const vec3 along = unit(vec3(tangent));
  return along == vec3(0) ? vec4(0, 0, 0, 1) : vec4(along, tangent.w);
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

void mend_tangents(MeshData& mesh) {
  const auto lost = [](const vec4& tangent) { return unit(vec3(tangent)) == vec3(0); };
  if (std::ranges::none_of(mesh.tangents, lost)) return;
  std::vector<vec4> own(mesh.tangents.size(), vec4(0));
  for (const uvec3& t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) own[t[i]] += tangent_of(mesh, t);
  }
  for (std::size_t v = 0; v < own.size(); ++v) {
    if (!lost(mesh.tangents[v])) continue;
    own[v].w = own[v].w < 0 ? -1.0f : 1.0f;
    mesh.tangents[v] = unit_tangent(own[v]);
  }
}

}  // namespace heliograph::assets::gltf
