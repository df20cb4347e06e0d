// glTF materials to PutMaterial.
#pragma once

#include "renderer/assets/gltf/textures.h"

namespace heliograph::assets::gltf {

/// Materials as the rest of the loader needs them.
struct Materials {
  std::vector<Ref> refs;             // by glTF material index
  std::vector<bool> wants_tangents;  // by glTF material index: along TEXCOORD_0
  Ref fallback;                      // for primitives without a material; may be monostate
  std::optional<u32> variant{};      // that is shown; see variants.h
};

/// Adds textures, then materials to the library. `needs_fallback`: some primitive names no
/// material.
[[nodiscard]] Materials load_materials(Document& document, Builder& builder, bool needs_fallback);

}  // namespace heliograph::assets::gltf
