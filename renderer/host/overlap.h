// Test of whether two meshes meet. Called by queries.cpp.
#pragma once

#include "renderer/host/tracer.h"

namespace heliograph::host {

/// True if the surfaces of two slots intersect, or one lies inside the other.
///
/// Two triangles that are not coplanar intersect exactly when an edge of one crosses the other, so
/// every edge of each mesh is cast as a segment against the other. Containment: the first surface
/// of the other that a ray from a vertex meets shows its back (surfaces are closed,
/// counter-clockwise seen from outside). Coplanar faces that only touch do not count.
[[nodiscard]] bool overlap(const Placement& placement, const HostTracer& tracer, u32 a, u32 b);

}  // namespace heliograph::host
