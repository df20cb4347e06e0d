// A mesh while it is being put together, and the steps every format shares: axes, and
// the checks before it becomes a PutMesh.
#pragma once

#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

#include "renderer/assets/budget.h"
#include "renderer/scene/transaction.h"

namespace heliograph::assets {

/// Arrays are per vertex, and empty or as long as `positions`; per triangle for `parts`.
struct MeshData {
  std::vector<vec3> positions;
  std::vector<vec3> normals;
  std::vector<vec2> uvs, uvs1;  // v = 0 is the bottom row
  std::vector<vec4> colors;     // linear
  std::vector<vec4> tangents;
  std::vector<glm::u16vec4> joints;
  std::vector<vec4> weights;
  std::vector<uvec3> triangles;
  std::vector<u32> parts;
  std::vector<std::string> part_names;
  std::vector<std::vector<vec3>> morph_positions;  // by target, as long as `positions`
  std::vector<std::vector<vec3>> morph_normals;    // empty, or as long as `positions` each
};

/// Calls a function with every array that has a value for each vertex; some are empty.
template <class F>
void for_each_vertex_array(MeshData& mesh, const F& f) {
  f(mesh.positions);
  f(mesh.normals);
  f(mesh.uvs);
  f(mesh.uvs1);
  f(mesh.colors);
  f(mesh.tangents);
  f(mesh.joints);
  f(mesh.weights);
  for (auto& target : mesh.morph_positions) f(target);
  for (auto& target : mesh.morph_normals) f(target);
}

/// Hash of a vertex whose members are all of one size. They are loaded as they were stored, one by
/// one: two at once would wait for both stores, which takes longer than the rest.
struct VertexHash {
  template <class T>
  std::size_t operator()(const T& vertex) const {
    std::conditional_t<alignof(T) == sizeof(u64), u64, u32> member;
    u64 hash = 0;
    for (std::size_t at = 0; at < sizeof vertex; at += sizeof member) {
      std::memcpy(&member, reinterpret_cast<const char*>(&vertex) + at, sizeof member);
      hash = hash * 0x9E3779B97F4A7C15ull + member;
    }
    return std::size_t((hash ^ hash >> 29) * 0xBF58476D1CE4E5B9ull);
  }
};

/// Vector of length 1; 0 for what has no direction, a NaN too.
[[nodiscard]] vec3 unit(const vec3& v);

struct FinishedMesh {
  PutMesh put;
  u64 mended_normals = 0;  // that had no direction, and have that of their triangles
};
/// Checks counts and indices, makes normals unit, and takes the arrays.
[[nodiscard]] FinishedMesh finish_mesh(MeshData mesh, const std::string& where, Budget& budget);

/// Turns the up axis ("x", "y", "z", "") to +Z: z_up_from("y") maps (x, y, z) to (x, -z, y).
[[nodiscard]] mat3 z_up_from(const std::string& up);

}  // namespace heliograph::assets
