// Primitives that Draco packed.
#pragma once

#include "renderer/assets/gltf/document.h"

namespace heliograph::assets::gltf {

/// Unpacks every primitive with KHR_draco_mesh_compression: its accessors then have what was in it.
void unpack_draco(Document& document, Budget& budget);

}  // namespace heliograph::assets::gltf
