#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "renderer/assets/assimp/scene.h"
#include "renderer/assets/polygon.h"

namespace heliograph::assets::assimp {
namespace {

constexpr std::size_t kInfluences = 4;  // joints at a vertex

/// Meshes become one here, a part each.
class Merger {
 public:
  Merger(Builder& builder, std::string where) : builder_(builder), where_(std::move(where)) {}

  MeshData data;
  std::vector<std::string> joints;
  std::vector<mat4x3> inverse_binds;
  std::vector<float> morph_weights;

  void add(const aiMesh& mesh, const std::string& part) {
    base_ = u32(data.positions.size());
    const u32 count = mesh.mNumVertices;
    builder_.budget.take(count, sizeof(vec3), where_);
    for (u32 i = 0; i < count; ++i) data.positions.push_back(vector_of(mesh.mVertices[i]));
    add_rows(data.normals, mesh.mNormals, count, vector_of);
    const auto uv = [](const aiVector3D& t) {
      return std::isfinite(t.x + t.y) ? vec2(t.x, t.y) : vec2(0);
    };
    add_rows(data.uvs, mesh.mTextureCoords[0], count, uv);
    add_rows(data.uvs1, mesh.mTextureCoords[1], count, uv);
    add_rows(
        data.colors, mesh.mColors[0], count,
        [](const aiColor4D& c) {
          return std::isfinite(c.r + c.g + c.b + c.a) ? vec4(c.r, c.g, c.b, c.a) : vec4(1);
        },
        vec4(1));
    add_bones(mesh);
    add_morphs(mesh);
    add_faces(mesh);
    data.part_names.push_back(part);
  }

  /// Fills what a part lacks with 0; such a normal becomes that of its faces.
  void finish() {
    const std::size_t count = data.positions.size();
    fit(data.normals, count);
    fit(data.uvs, count);
    fit(data.uvs1, count);
    fit(data.colors, count, vec4(1));
    if (!data.colors.empty()) {
      clamp_colors(data.colors, builder_);
      make_linear(data.colors);
    }
    for (auto& target : data.morph_positions) fit(target, count);
    const bool has_normals = std::ranges::all_of(
        data.morph_normals, [&](const auto& target) { return target.size() == count; });
    if (!has_normals || data.normals.empty()) data.morph_normals.clear();
    finish_bones();
  }

 private:
  template <class T>
  static void fit(std::vector<T>& rows, std::size_t count, T missing = T(0)) {
    if (!rows.empty()) rows.resize(count, missing);
  }

  template <class T, class From, class Convert>
  void add_rows(std::vector<T>& out, const From* rows, u32 count, Convert convert,
                T missing = T(0)) {
    if (!rows) return;
    builder_.budget.take(base_ + count - out.size(), sizeof(T), where_);
    out.resize(base_, missing);
    for (u32 i = 0; i < count; ++i) out.push_back(convert(rows[i]));
  }

  void add_faces(const aiMesh& mesh) {
    std::vector<glm::dvec3> corners;
    std::vector<uvec3> cut;
    for (u32 f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      const std::span<const u32> indices(face.mIndices, face.mNumIndices);
      if (indices.size() < 3) {
        builder_.warn("points and lines are left out");
        continue;
      }
      cut.assign(1, uvec3(0, 1, 2));
      if (indices.size() > 3) {
        corners.clear();
        for (const u32 i : indices) corners.push_back(vector_of(mesh.mVertices[i]));
        triangulate(corners, cut);
      }
      builder_.budget.take(cut.size(), sizeof(uvec3) + sizeof(u32), where_);
      for (const uvec3& t : cut)
        data.triangles.push_back(base_ + uvec3(indices[t.x], indices[t.y], indices[t.z]));
      data.parts.insert(data.parts.end(), cut.size(), u32(data.part_names.size()));
    }
  }

  struct Influence {
    float weight = 0;
    u16 joint = 0;
  };

  u16 joint_of(const aiBone& bone) {
    const std::string name = text_of(bone.mName);
    const mat4x3 inverse_bind = matrix_of(bone.mOffsetMatrix);
    for (std::size_t i = 0; i < joints.size(); ++i)
      if (joints[i] == name && inverse_binds[i] == inverse_bind) return u16(i);
    Budget::check(joints.size() + 1, 0x10000, "joints", where_);
    joints.push_back(name);
    inverse_binds.push_back(inverse_bind);
    return u16(joints.size() - 1);
  }

  void add_bones(const aiMesh& mesh) {
    if (!mesh.HasBones()) return;
    builder_.budget.take(mesh.mNumVertices, sizeof(vec4) + sizeof(glm::u16vec4), where_);
    influences_.resize(data.positions.size());
    for (u32 b = 0; b < mesh.mNumBones; ++b) {
      const aiBone& bone = *mesh.mBones[b];
      const u16 joint = joint_of(bone);
      for (u32 w = 0; w < bone.mNumWeights; ++w) {
        const aiVertexWeight& weight = bone.mWeights[w];
        if (weight.mVertexId < mesh.mNumVertices && weight.mWeight > 0)
          add_influence(influences_[base_ + weight.mVertexId], {float(weight.mWeight), joint});
      }
    }
  }

  /// The strongest stay.
  void add_influence(std::array<Influence, kInfluences>& all, Influence added) {
    auto& weakest = *std::ranges::min_element(all, {}, &Influence::weight);
    if (weakest.weight > 0) builder_.warn("of more than 4 joints at a vertex the strongest count");
    if (weakest.weight < added.weight) weakest = added;
  }

  void finish_bones() {
    if (joints.empty()) return;
    influences_.resize(data.positions.size());
    for (const auto& all : influences_) {
      float sum = 0;
      for (const Influence& one : all) sum += one.weight;
      if (!(sum > 0)) builder_.warn("vertices that no joint moves follow the first");
      glm::u16vec4 indices(0);
      vec4 weights(sum > 0 ? 0 : 1, 0, 0, 0);
      for (int k = 0; k < int(kInfluences) && sum > 0; ++k) {
        indices[k] = all[std::size_t(k)].joint;
        weights[k] = all[std::size_t(k)].weight / sum;
      }
      data.joints.push_back(indices);
      data.weights.push_back(weights);
    }
  }

  void add_morphs(const aiMesh& mesh) {
    const u32 count = mesh.mNumAnimMeshes;
    data.morph_positions.resize(count);
    data.morph_normals.resize(count);
    morph_weights.resize(count);
    for (u32 m = 0; m < count; ++m) {
      const aiAnimMesh& target = *mesh.mAnimMeshes[m];
      morph_weights[m] = float(target.mWeight);
      const u32 vertices = std::min(target.mNumVertices, mesh.mNumVertices);
      add_differences(data.morph_positions[m], target.mVertices, mesh.mVertices, vertices);
      add_differences(data.morph_normals[m], target.mNormals, mesh.mNormals, vertices);
    }
  }
  void add_differences(std::vector<vec3>& out, const aiVector3D* to, const aiVector3D* from,
                       u32 count) {
    builder_.budget.take(count, sizeof(vec3), where_);
    out.resize(base_, vec3(0));
    if (!to || !from) return;
    for (u32 i = 0; i < count; ++i) out.push_back(vector_of(to[i]) - vector_of(from[i]));
  }

  Builder& builder_;
  const std::string where_;
  u32 base_ = 0;  // vertices of the parts before
  std::vector<std::array<Influence, kInfluences>> influences_;
};

bool has_triangles(const aiMesh& mesh) {
  return std::ranges::any_of(std::span(mesh.mFaces, mesh.mNumFaces),
                             [](const aiFace& face) { return face.mNumIndices > 2; });
}

}  // namespace

std::vector<const Shape*> Meshes::of(const aiNode& node) {
  std::map<std::pair<bool, u32>, std::vector<u32>> alike;
  for (u32 i = 0; i < node.mNumMeshes; ++i) {
    const u32 index = node.mMeshes[i];
    const aiMesh& mesh = *scene_.mMeshes[index];
    if (has_triangles(mesh)) {
      alike[{mesh.HasBones(), mesh.mNumAnimMeshes}].push_back(index);
    } else {
      builder_.warn("points and lines are left out");
    }
  }
  std::vector<const Shape*> shapes;
  for (const auto& [key, parts] : alike) {
    auto made = made_.find(parts);
    if (made == made_.end()) made = made_.emplace(parts, make(parts, text_of(node.mName))).first;
    shapes.push_back(&made->second);
  }
  return shapes;
}

Shape Meshes::make(const std::vector<u32>& parts, const std::string& name) {
  Merger merger(builder_, fmt::format("mesh '{}'", clean_name(name, "?")));
  Shape shape;
  for (const u32 index : parts) {
    const aiMesh& mesh = *scene_.mMeshes[index];
    const aiString material = scene_.mMaterials[mesh.mMaterialIndex]->GetName();
    merger.add(mesh, clean_name(text_of(material), fmt::format("part_{}", index)));
    shape.materials.push_back(materials_[mesh.mMaterialIndex]);
  }
  merger.finish();
  if (!merger.data.colors.empty()) white_.fill(shape.materials, builder_);
  shape.joints = std::move(merger.joints);
  shape.inverse_binds = std::move(merger.inverse_binds);
  shape.morph_weights = std::move(merger.morph_weights);
  const std::string where = fmt::format("mesh '{}'", clean_name(name, "?"));
  shape.mesh = builder_.library(builder_.claim_name(name, "mesh"),
                                finish_mesh(std::move(merger.data), where, builder_.budget).put);
  return shape;
}

}  // namespace heliograph::assets::assimp
