// One glTF primitive: its triangles, and the vertices that its attributes name.
#pragma once

#include "renderer/assets/gltf/document.h"
#include "renderer/assets/mesh_data.h"

namespace heliograph::assets::gltf {

/// Triangles of a list, strip or fan, every index below `vertices`.
[[nodiscard]] std::vector<uvec3> read_triangles(const Document& document, const Value& primitive,
                                                u32 vertices, Builder& builder);

/// The vertices of a primitive, as stored: no triangles, no parts. Normals, tangents and texture
/// coordinates that are not finite are zeros; tangents without normals are not read.
[[nodiscard]] MeshData read_vertices(const Document& document, const Value& primitive,
                                     Builder& builder);

}  // namespace heliograph::assets::gltf
