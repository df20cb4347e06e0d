// Level sets to a mesh, for volume.cpp.
#pragma once

#include "renderer/assets/model.h"
#include "renderer/assets/volume_bricks.h"

namespace heliograph::assets {

/// Adds the surface where a level set is 0 as a part `name`, in the file's axes and unit; normals
/// are the level set's gradients. By OpenVDB's volumeToMesh: dual marching cubes (Nielson 2004,
/// "Dual marching cubes") without adaptivity, a vertex for each sheet of the surface in a voxel.
void add_surface(const Bricks& bricks, const Bricks::Read& read, const std::string& name,
                 Model& model, Budget& budget);

}  // namespace heliograph::assets
