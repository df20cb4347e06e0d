// Which entities focus light, so that paths look for them (kernels/light/caster.h).
#pragma once

#include "renderer/lights/lights.h"

namespace heliograph::resident {

/// Spheres about the entities whose material is a mirror or a lens; none where there are more than
/// kMostCasters.
///
/// slots   Surfaces::focusing
[[nodiscard]] std::vector<kernels::CasterView> find_casters(const Placement& placement,
                                                            const Materials& materials,
                                                            std::span<const u32> slots);
/// Spheres about the lights and suns of a scene; none where there are more than kMostCastLights.
[[nodiscard]] std::vector<kernels::CastLightView> find_cast_lights(const Lights& lights,
                                                                   const Box& scene);
/// How often a path looks for them: less the more light comes from the dome, which rough surfaces
/// find through a mirror in any case.
[[nodiscard]] float caster_probability(const Lights& lights);

}  // namespace heliograph::resident
