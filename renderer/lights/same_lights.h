// Parts of earlier lights that serve again. Called by lights.cpp.
#pragma once

#include "renderer/lights/lights.h"

namespace heliograph::resident {

/// True if the same slots may emit.
[[nodiscard]] bool has_same_slots(const LightSources& now, const LightsBefore& before);
/// True if all that lights are made of is the same. May be false although it is.
[[nodiscard]] bool has_same_sources(const LightSources& now, const LightsBefore& before);
/// True if lights are of the same parts of the same slots.
[[nodiscard]] bool has_same_parts(std::span<const kernels::LightView> a,
                                  std::span<const kernels::LightView> b);
/// The table SceneView::part_lights.
[[nodiscard]] std::shared_ptr<const std::vector<u32>> part_lights_of(
    const Structure& structure, std::span<const kernels::LightView> lights);

}  // namespace heliograph::resident
