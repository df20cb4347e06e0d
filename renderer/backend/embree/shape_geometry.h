// Discs and spheres as geometries of Embree. Called by mesh.cpp.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/backend/embree/embree.h"

namespace heliograph::embree {

/// The unit shape of kernels/geometry/shape.h, committed: its primitive 0, whose u and v are the
/// place. Rays ask no filter about it.
[[nodiscard]] GeometryHandle shape_geometry(kernels::Shape shape, RTCDevice device);

}  // namespace heliograph::embree
