#include "renderer/assets/mesh_data.h"

#include <algorithm>
#include <cmath>

#include "renderer/base/finite.h"

namespace heliograph::assets {
namespace {

/// Unit normals. One without a direction takes the one of its triangles, by area; +Z where these
/// have none, so that shading never sees a NaN. Returns how many had none.
u64 normalise(MeshData& mesh) {
  std::vector<vec3>& normals = mesh.normals;
  u64 lost = 0;
  for (vec3& normal : normals) {
    normal = unit(normal);
    lost += normal == vec3(0);
  }
  if (lost == 0) return lost;
  std::vector<glm::dvec3> own(normals.size());
  for (const uvec3& t : mesh.triangles) {
    const glm::dvec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    for (const u32 i : {t.x, t.y, t.z}) own[i] += glm::cross(b - a, c - a);
  }
  for (std::size_t i = 0; i < normals.size(); ++i) {
    if (normals[i] != vec3(0)) continue;
    const double length = glm::length(own[i]);
    normals[i] = length > 0 ? vec3(own[i] / length) : vec3(0, 0, 1);
  }
  return lost;
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

}  // namespace

vec3 unit(const vec3& v) {
  const float length = float(glm::length(glm::dvec3(v)));  // no square is beyond a double
  return length > 1e-20f && std::isfinite(length) ? v / length : vec3(0);
}

FinishedMesh finish_mesh(MeshData mesh, const std::string& where, Budget& budget) {
  const LoadLimits& limits = budget.limits();
  const std::size_t count = mesh.positions.size();
  Budget::check(count, limits.vertices, "vertices", where);
  Budget::check(mesh.triangles.size(), limits.triangles, "triangles", where);
  if (mesh.triangles.empty()) refuse(where, "the mesh has no triangles");
  if (!all_finite({reinterpret_cast<const float*>(mesh.positions.data()), 3 * count}))
    refuse(where, "a position is not finite");
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
  const u64 mended = normalise(mesh);

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
  return {{.topology = std::move(topology), .vertices = std::move(vertices)}, mended};
}

mat3 z_up_from(const std::string& up) {
  if (up == "y") return mat3(vec3(1, 0, 0), vec3(0, 0, 1), vec3(0, -1, 0));
  if (up == "x") return mat3(vec3(0, 0, 1), vec3(0, 1, 0), vec3(-1, 0, 0));
  return mat3(1);
}

}  // namespace heliograph::assets
