// Primitives that are no triangles as geometries of Embree. Called by mesh.cpp.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/backend/embree/embree.h"

namespace heliograph::embree {

/// Discs, spheres or curves, by the formulas of kernels/geometry/primitive.h, committed. u and v of
/// hits are the place. Rays ask their filter about curves alone. Lifetime: of the view.
[[nodiscard]] GeometryHandle primitive_geometry(const kernels::MeshView& mesh, RTCDevice device);

}  // namespace heliograph::embree
