// glTF meshes to PutMesh: one mesh object for each glTF mesh, its primitives as parts.
#pragma once

#include "renderer/assets/gltf/materials.h"

namespace heliograph::assets::gltf {

struct Mesh {
  Ref ref;                     // monostate: nothing of it is a surface
  std::vector<Ref> materials;  // by part
  u32 morph_count = 0;
  std::vector<float> morph_weights;  // the mesh's own; empty: zeros
  u32 joint_count = 0;               // one more than the largest joint used; 0: no skin data
  std::shared_ptr<const MeshTopology> topology;
  std::shared_ptr<const VertexKeys> vertices;
};

/// Adds every mesh to the library.
[[nodiscard]] std::vector<Mesh> load_meshes(const Document& document, Builder& builder,
                                            const Materials& materials);

/// The weights of morph targets that a mesh or a node gives; empty: it gives none.
[[nodiscard]] std::vector<float> read_weights(const Value& owner, u32 targets);

/// True if some primitive names no material.
[[nodiscard]] bool any_without_material(const Document& document, std::optional<u32> variant);

}  // namespace heliograph::assets::gltf
