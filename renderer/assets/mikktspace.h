// Tangents of a mesh that brings none, as those who bake normal maps compute them. Called by
// loaders.
#pragma once

#include "renderer/assets/mesh_data.h"

namespace heliograph::assets {

/// Gives a mesh that has normals and `uvs` unit tangents along growing u, w the side on which v
/// grows. A vertex whose triangles form several groups is split: the first keeps its index, copies
/// with all that it has follow after the last vertex. Where no triangle has a direction, zeros.
///
/// Source: Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited", with its defaults: no angle
/// divides a group.
void add_tangents(MeshData& mesh, Budget& budget);

}  // namespace heliograph::assets
