// Normals and tangents that a glTF leaves out, or that have no direction.
#pragma once

#include "renderer/assets/mesh_data.h"

namespace heliograph::assets::gltf {

/// A vertex of its own for every corner, and each triangle's own normal.
[[nodiscard]] MeshData flat_shaded(const MeshData& vertices, const std::vector<uvec3>& triangles,
                                   Budget& budget);

/// Tangents without a direction become those of the triangles about the vertex; normals do in
/// finish_mesh().
void mend_tangents(MeshData& mesh);

}  // namespace heliograph::assets::gltf
