// Where on the canvas of a camera something may be seen. Called by silhouettes.cpp and queries.cpp.
#pragma once

#include <array>

#include "renderer/placement/placement.h"

namespace heliograph::resident {

/// The image extended on each side by `extend` times its size; an equirectangular camera sees all
/// there is already, and its canvas is its image.
[[nodiscard]] PixelBox canvas_of(const kernels::CameraView& camera, float extend);

/// Pixels [x0, x1) x [y0, y1) that a box may cover, within `canvas`. corners: of the box, world.
[[nodiscard]] PixelBox bounds_on_canvas(const std::array<vec3, 8>& corners,
                                        const kernels::CameraView& camera, const PixelBox& canvas);
/// The same of a slot's surface.
[[nodiscard]] PixelBox bounds_on_canvas(const Placement& placement, u32 slot,
                                        const kernels::CameraView& camera, const PixelBox& canvas);

}  // namespace heliograph::resident
