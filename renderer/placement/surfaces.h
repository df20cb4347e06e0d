// Traits of a structure's slots by their materials, wherever they are.
#pragma once

#include "renderer/derived/materials.h"
#include "renderer/placement/structure.h"

namespace heliograph::resident {

/// True if most of what a material gives off is reflected or refracted sharply. Textures are not
/// looked at.
[[nodiscard]] bool focuses(const kernels::MaterialView& material);

/// By slot, whether it has kMayBeHole; null: none has.
using HoleSlots = std::shared_ptr<const std::vector<u8>>;

struct Surfaces {
  HoleSlots holes;
  std::vector<u32> focusing;  // slots that reflect or refract light sharply
  kernels::SceneView all{};   // totals of all materials in use, by accumulate_features()
};

/// A function of the materials and the structure. `before`, or null, has the same structure: holes
/// that are the same are shared with it.
[[nodiscard]] std::shared_ptr<const Surfaces> make_surfaces(const Structure& structure,
                                                            const Materials& materials,
                                                            const Surfaces* before);

}  // namespace heliograph::resident
