// Builds of Embree scenes that can be given up. Called by placement.cpp and static_group.cpp.
#pragma once

#include "renderer/backend/embree/embree.h"
#include "renderer/engine/backend.h"

namespace heliograph::embree {

/// Builds the acceleration structure of a scene. Fails as the interrupt says, or with
/// RESOURCE_EXHAUSTED.
[[nodiscard]] Status commit(RTCScene scene, RTCDevice device, const Interrupt& interrupt);

}  // namespace heliograph::embree
