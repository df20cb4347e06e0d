// Textures at smaller sizes, for what is seen from afar. Called by materials.cpp.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/derived/derived_cache.h"
#include "renderer/scene/components.h"

namespace heliograph::resident {

/// The levels 1, 2, ... of a texture one after the other, in its own type and channels: each has
/// half the size of the one before, rounded down but at least 1, and its texels are means of
/// decoded texels.
struct Mips {
  std::vector<std::byte> texels;
  [[nodiscard]] u64 bytes() const { return texels.size(); }
};

/// Null for a texture that is looked up by the nearest texel, or is one texel wide or high.
[[nodiscard]] std::shared_ptr<const Mips> mips_of(const Texture& texture,
                                                  const kernels::TextureView& view,
                                                  DerivedCache& cache);
/// True if mips_of() would have to make them.
[[nodiscard]] bool needs_mips(const Texture& texture, const DerivedCache& cache);

}  // namespace heliograph::resident
