// OpenVDB's grids to bricks: whatever they hold, as numbers. Used by volume_vdb.cpp.
#pragma once

#include <openvdb/openvdb.h>

#include "renderer/assets/volume_file.h"

namespace heliograph::assets {

/// Types of grids that a volume can show: scalars and vectors of three.
using ShownGrids = openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid,
                                     openvdb::Int64Grid, openvdb::BoolGrid, openvdb::MaskGrid,
                                     openvdb::Vec3SGrid, openvdb::Vec3DGrid, openvdb::Vec3IGrid>;

/// Number of channels of one of ShownGrids: 1 or 3.
[[nodiscard]] u32 channels_of(const openvdb::GridBase& grid);

/// Calls with the bricks of one of ShownGrids. A frustum becomes a box of voxels as large as those
/// in its middle.
void use_bricks(const openvdb::GridBase& grid, const std::string& name, Budget& budget,
                const VolumeFile::Use& use);

}  // namespace heliograph::assets
