// One glTF primitive: its triangles, and the vertices that its attributes name.
#pragma once

#include "renderer/assets/gltf/document.h"
#include "renderer/assets/mesh_data.h"

namespace heliograph::assets::gltf {

/// Triangles of a list, strip or fan, every index below `vertices`.
[[nodiscard]] std::vector<uvec3> read_triangles(const Document& document, const Value& primitive,
                                                u32 vertices, Budget& budget);

/// The vertices of a primitive, as stored: no triangles, no parts.
[[nodiscard]] MeshData read_vertices(const Document& document, const Value& primitive,
                                     Builder& builder);

/// A vertex of its own for every corner, and each triangle's own normal.
[[nodiscard]] MeshData flat_shaded(const MeshData& vertices, const std::vector<uvec3>& triangles,
                                   Budget& budget);

}  // namespace heliograph::assets::gltf
