#include <map>

#include "renderer/assets/dae/document.h"

namespace heliograph::assets::dae {
namespace {

void add_skin(MeshData& mesh, const MeshData& skin, std::span<const Rows> rows) {
  for (const Rows& row : rows) {
    if (row.position >= skin.joints.size())
      refuse("vertex_weights", fmt::format("has {} vertices, but the geometry uses vertex {}",
                                           skin.joints.size(), row.position));
    mesh.joints.push_back(skin.joints[row.position]);
    mesh.weights.push_back(skin.weights[row.position]);
  }
}

/// Normals of vertices at these positions: of one vertex all faces that share its position and
/// normal count, by their area.
class Normals {
 public:
  Normals(const MeshData& mesh, std::span<const Rows> rows) : mesh_(mesh) {
    std::map<std::pair<u32, u32>, u32> known;
    for (const Rows& row : rows) {
      const std::pair key(row.position, row.normal);
      group_.push_back(known.try_emplace(key, u32(known.size())).first->second);
    }
    groups_ = known.size();
  }

  [[nodiscard]] std::vector<vec3> at(const std::vector<vec3>& moved) const {
    std::vector<glm::dvec3> sums(groups_);
    const auto corner = [&](u32 i) { return glm::dvec3(mesh_.positions[i] + moved[i]); };
    for (const uvec3& t : mesh_.triangles) {
      const glm::dvec3 a = corner(t.x);
      const glm::dvec3 normal = glm::cross(corner(t.y) - a, corner(t.z) - a);
      for (const u32 i : {t.x, t.y, t.z}) sums[group_[i]] += normal;
    }
    std::vector<vec3> out;
    for (const u32 group : group_) out.push_back(unit(vec3(sums[group])));
    return out;
  }

 private:
  const MeshData& mesh_;
  std::vector<u32> group_;  // by vertex
  std::size_t groups_ = 0;
};

void add_targets(MeshData& mesh, const Deformation& deformation, std::span<const Rows> rows,
                 Budget& budget) {
  const Normals normals(mesh, rows);
  const std::vector<vec3> rest = normals.at(std::vector<vec3>(rows.size(), vec3(0)));
  for (const std::vector<vec3>& target : deformation.targets) {
    budget.take(rows.size(), 2 * sizeof(vec3), "targets");
    std::vector<vec3>& positions = mesh.morph_positions.emplace_back();
    for (const Rows& row : rows) {
      if (row.position >= target.size())
        refuse("targets", fmt::format("have {} vertices, but the geometry uses vertex {}",
                                      target.size(), row.position));
      positions.push_back(target[row.position]);
    }
    if (mesh.normals.empty()) continue;
    std::vector<vec3>& turned = mesh.morph_normals.emplace_back(normals.at(positions));
    for (std::size_t i = 0; i < turned.size(); ++i) turned[i] -= rest[i];
  }
}

}  // namespace

void deform(MeshData& mesh, const Deformation& deformation, std::span<const Rows> rows,
            Budget& budget) {
  if (!deformation.joints.empty()) {
    budget.take(rows.size(), sizeof(vec4) + sizeof(glm::u16vec4), "vertex_weights");
    add_skin(mesh, deformation.skin, rows);
  }
  if (!deformation.targets.empty()) add_targets(mesh, deformation, rows, budget);
}

}  // namespace heliograph::assets::dae
