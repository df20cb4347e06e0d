// Which entities focus light, so that paths look for them (kernels/light/caster.h).
#pragma once

#include "renderer/lights/lights.h"

namespace heliograph::resident {

/// Things that paths look for, and the lights whose images they look for in them.
struct Casters {
  std::vector<kernels::CasterView> casters;
  std::vector<kernels::CastLightView> lights;  // empty where there are no casters
  float probability = 0;                       // with which a path looks for them
};

/// Spheres about the entities whose material is a mirror or a lens, and about lights and suns. Of
/// more than kMostCasters those that catch the most light stay, of more than kMostCastLights those
/// that give the most (of 64, the most powerful). The smaller their share of what all catch or
/// give, the less are they looked for; below a half, not at all. A path looks for them less, too,
/// the more light comes from the dome, which rough surfaces find through a mirror in any case.
///
/// slots   Surfaces::focusing
[[nodiscard]] Casters find_casters(const Placement& placement, const Materials& materials,
                                   std::span<const u32> slots, const Lights& lights);

}  // namespace heliograph::resident
