// A file as assimp reads it, and its numbers as ours. Used by the files of this folder.
#pragma once

#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#include <map>
#include <string>
#include <vector>

#include "renderer/assets/model.h"

namespace heliograph::assets::assimp {

[[nodiscard]] inline std::string text_of(const aiString& text) { return {text.data, text.length}; }
[[nodiscard]] inline vec3 vector_of(const aiVector3D& v) { return {v.x, v.y, v.z}; }
[[nodiscard]] inline mat4x3 matrix_of(const aiMatrix4x4& m) {
  return {vec3(m.a1, m.b1, m.c1), vec3(m.a2, m.b2, m.c2), vec3(m.a3, m.b3, m.c3),
          vec3(m.a4, m.b4, m.c4)};
}

// import.cpp
/// The scene of the builder's model, which the importer owns.
[[nodiscard]] const aiScene& import_scene(Assimp::Importer& importer, Builder& builder);
/// Metres and +Z up of the scene's coordinates, whose root is the first node's parent: what the
/// file states, or its format's custom, unless the caller gives others.
[[nodiscard]] mat4x3 world_from_scene(const aiScene& scene, const Builder& builder);

// materials.cpp
/// Adds textures and materials to the library; by the scene's index, nothing for those that no mesh
/// uses and for what assimp makes where a file has none.
[[nodiscard]] std::vector<Ref> load_materials(const aiScene& scene, Builder& builder);

// meshes.cpp
/// Meshes of one node that are alike but for their material: a part each.
struct Shape {
  Ref mesh;
  std::vector<Ref> materials;  // by part
  std::vector<std::string> joints;
  std::vector<mat4x3> inverse_binds;
  std::vector<float> morph_weights;
};
class Meshes {
 public:
  Meshes(const aiScene& scene, Builder& builder, const std::vector<Ref>& materials)
      : scene_(scene), builder_(builder), materials_(materials) {}

  /// Adds the meshes of a node to the library, unless another node has the same. One shape, or one
  /// for each way of deforming.
  [[nodiscard]] std::vector<const Shape*> of(const aiNode& node);

 private:
  [[nodiscard]] Shape make(const std::vector<u32>& parts, const std::string& name);

  const aiScene& scene_;
  Builder& builder_;
  const std::vector<Ref>& materials_;
  std::map<std::vector<u32>, Shape> made_;  // by the scene's meshes
  White white_;
};

// animations.cpp
/// A node and what it became.
struct Placed {
  const aiNode* node;
  u32 entity;
  std::vector<std::pair<u32, std::vector<float>>>
      morphs;  // entities that show them, weights at rest
};
[[nodiscard]] std::vector<Asset::Animation> load_animations(
    const aiScene& scene, Builder& builder, const std::map<std::string, Placed>& placed);

}  // namespace heliograph::assets::assimp
