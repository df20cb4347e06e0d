// Portals of the dome, and their maps. Called by lights.cpp.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/derived/derived_cache.h"
#include "renderer/scene/components.h"

namespace heliograph::resident {

/// Sets all but the sums; false where the pose leaves no area.
[[nodiscard]] bool place_portal(const Portal& portal, const mat4x3& world,
                                kernels::PortalView& out);

struct PortalMap {
  std::vector<double> sums;  // of kernels::PortalView
  [[nodiscard]] u64 bytes() const { return sums.size() * sizeof(double); }
};
/// The map of a portal that has its axes. texture: the dome's, null: constant.
[[nodiscard]] std::shared_ptr<const PortalMap> portal_map(const Texture* texture,
                                                          const kernels::DomeView& dome,
                                                          const kernels::PortalView& portal,
                                                          DerivedCache& cache);

}  // namespace heliograph::resident
