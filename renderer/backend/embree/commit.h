// Builds of Embree scenes. Called by mesh.cpp, top_level.cpp and static_group.cpp.
#pragma once

#include "renderer/backend/embree/embree.h"
#include "renderer/device/backend.h"

namespace heliograph::embree {

/// Builds the acceleration structure of a scene. Returns the error of whichever thread did. Apart
/// from the TBB task that calls it: Embree's task group lives as long as the scene, and below that
/// task it would keep a pointer to its context, which TBB follows when any other build is given up.
RTCError commit(RTCScene scene, RTCDevice device);

/// The same, until the interrupt requests that it is given up. Fails as the interrupt does, or with
/// RESOURCE_EXHAUSTED.
[[nodiscard]] Status commit(RTCScene scene, RTCDevice device, const Interrupt& interrupt);

}  // namespace heliograph::embree
