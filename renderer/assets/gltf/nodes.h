// The node hierarchy of a glTF: checked to be a tree, and made into entities.
#pragma once

#include "renderer/assets/gltf/meshes.h"
#include "renderer/assets/lamps.h"

namespace heliograph::assets::gltf {

/// The nodes as data: every number read, every index checked, every node at most one parent, no
/// cycle.
struct Node {
  Value value;
  std::string name;  // claimed
  std::optional<u32> parent;
  std::vector<u32> children;
  bool has_matrix = false;
  mat4x3 local{1};           // parent_from_node
  glm::vec3 translation{0};  // when not has_matrix
  glm::quat rotation{1, 0, 0, 0};
  glm::vec3 scale{1};
};
[[nodiscard]] std::vector<Node> read_nodes(const Document& document, Builder& builder);

/// Where the nodes went.
struct Entities {
  std::vector<std::optional<u32>> node;  // entity of each node; nullopt: not in the scene
  std::vector<std::optional<u32>> mesh;  // entity that shows its mesh; may be another
};
/// Objects that entities name.
struct Library {
  std::vector<Mesh> meshes;
  std::vector<std::optional<Ref>> profiles;  // of lights; without: nobody has its file
};
/// Adds the root, the turn to +Z up below it, and every node of the scene.
[[nodiscard]] Entities make_entities(const Document& document, Builder& builder,
                                     const std::vector<Node>& nodes, const Library& library);

/// The joints of a skin as node indices, and its inverse bind matrices.
struct SkinData {
  std::vector<u32> joints;
  std::vector<mat4x3> inverse_binds;
};
[[nodiscard]] SkinData read_skin(const Document& document, const Value& skin, std::size_t nodes,
                                 Budget& budget);

// lights.cpp
/// Adds the profiles of EXT_lights_ies to the library, but those that nobody has; by their index.
[[nodiscard]] std::vector<std::optional<Ref>> load_profiles(Document& document, Builder& builder);
/// A node whose lights are wanted.
struct NodeLights {
  Value node;
  Place below;
};
/// Adds the entities of a node's lights below it.
void add_lights(const Document& document, Builder& builder,
                const std::vector<std::optional<Ref>>& profiles, const NodeLights& lights);
[[nodiscard]] bool has_lights(const Value& node);
[[nodiscard]] Camera read_camera(const Value& camera);

}  // namespace heliograph::assets::gltf
