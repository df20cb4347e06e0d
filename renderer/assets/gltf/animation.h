// glTF animations to keyed poses and morph weights.
#pragma once

#include "renderer/assets/gltf/nodes.h"

namespace heliograph::assets::gltf {

[[nodiscard]] std::vector<Asset::Animation> load_animations(const Document& document,
                                                            Builder& builder,
                                                            const std::vector<Node>& nodes,
                                                            const Entities& entities,
                                                            const std::vector<Mesh>& meshes);

}  // namespace heliograph::assets::gltf
