// KHR_materials_anisotropy, in terms of our roughness and anisotropic.
#pragma once

#include "renderer/assets/gltf/textures.h"

namespace heliograph::assets::gltf {

/// Anisotropy as a material states it.
struct Anisotropy {
  std::string where;
  double strength = 0;
  double rotation = 0;             // radians, from the tangent towards the bitangent
  Boxed<TextureUsePatch> texture;  // direction in red and green, strength in blue
};
[[nodiscard]] Anisotropy read_anisotropy(const Value& brushed, Textures& textures);

/// Sets roughness, anisotropic and anisotropic_rotation of `put`. With a texture they become
/// textures of its size, which go to the library: call it between the other textures and the
/// materials.
void apply_anisotropy(const Anisotropy& anisotropy, const Textures& textures, Builder& builder,
                      PutMaterial& put);

}  // namespace heliograph::assets::gltf
