// Test for a camera in a closed room, where light that slips through a wall would be seen.
#pragma once

#include "renderer/backend/embree/second_look.h"

namespace heliograph::embree {

/// Rays of a picture that are looked at again: those that leave the room, where rays in 128
/// directions from the camera all meet something; else none.
[[nodiscard]] SecondLook second_look(const TracedScene& scene, const kernels::CameraView& camera);

}  // namespace heliograph::embree
