// Materials and textures as kernels see them.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/derived/derived_cache.h"
#include "renderer/scene/snapshot.h"

namespace heliograph::resident {

/// By row of the snapshot's tables; then the default material, and one that absorbs all light.
struct Materials {
  std::vector<kernels::MaterialView> materials;
  std::vector<kernels::TextureUseView> uses;
  std::vector<kernels::TextureView> textures;
  std::vector<std::shared_ptr<const void>> kept;  // texels and their mips
};

[[nodiscard]] std::shared_ptr<const Materials> make_materials(const Snapshot& snapshot,
                                                              DerivedCache& cache);
[[nodiscard]] kernels::TextureUseView view_of(const Snapshot& snapshot, const TextureUse& use);
[[nodiscard]] kernels::TextureView view_of(const Texture& texture);
/// By row, whether a material looks at a texture with a cone: for emission and alpha it does not.
[[nodiscard]] std::vector<bool> filtered_textures(const Snapshot& snapshot);
/// Names what is made of a texture's values alone, however it repeats.
[[nodiscard]] DerivedKey key_of(Derived kind, const Texture& texture);

/// Mean of the decoded texels, grey in all colours.
[[nodiscard]] vec4 texture_mean(const Texture& texture, DerivedCache& cache);

}  // namespace heliograph::resident
