// Builds the tree through which rays find volumes. Called by volumes.cpp.
#pragma once

#include <span>
#include <vector>

#include "kernels/bvh/bvh_box.h"

namespace heliograph::resident {

/// A balanced binary tree with a leaf for each of the boxes and the root first; a function of the
/// boxes alone.
[[nodiscard]] std::vector<kernels::VolumeNode> make_volume_tree(
    std::span<const kernels::BvhBox> boxes);

}  // namespace heliograph::resident
