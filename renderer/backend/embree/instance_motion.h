// Embree's side of kernels/motion.h. Called by placement.cpp.
#pragma once

#include <span>

#include "kernels/scene_view.h"
#include "renderer/backend/embree/embree.h"

namespace heliograph::embree {

/// Whether the pose has an inverse.
[[nodiscard]] bool usable_key(const kernels::MotionKey& key);

/// Whether they are the same bits.
[[nodiscard]] bool same_keys(std::span<const kernels::MotionKey> a,
                             std::span<const kernels::MotionKey> b);

/// Gives an instance its keys as time steps; Embree interpolates them as kernels::interpolate()
/// does.
void set_motion(RTCGeometry instance, std::span<const kernels::MotionKey> keys);

}  // namespace heliograph::embree
