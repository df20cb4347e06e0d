// Where lights are in the world, for the light tree. Called by lights.cpp.
#pragma once

#include <span>

#include "kernels/light/light_tree.h"
#include "renderer/base/types.h"

namespace heliograph::resident {

/// Bounds in the world of what has `bounds` in an instance's object space, over its whole motion,
/// but for the power. keys: of the instance; empty: it stands still.
[[nodiscard]] kernels::LightBounds world_bounds(const kernels::LightBounds& bounds,
                                                const kernels::InstanceView& instance,
                                                std::span<const kernels::MotionKey> keys);

}  // namespace heliograph::resident
