// Volume files written by OpenVDB itself, and voxels of what was read of them.
#pragma once

#include <openvdb/io/Archive.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <sstream>

#include "renderer/scene/components.h"
#include "tests/unit/asset_fixture.h"

namespace heliograph::test {

namespace vdb = openvdb;

/// Writes to memory: with `seekable` a file, without it a stream.
struct VdbWriter : vdb::io::Archive {
  bool seekable = true;

  using Archive::write;
  [[nodiscard]] TestBundle bundle(const vdb::GridCPtrVec& grids) const {
    std::ostringstream out;
    write(out, grids, seekable);
    return TestBundle().add("a.vdb", out.str());
  }
};

[[nodiscard]] inline Loaded loaded_of(const vdb::GridCPtrVec& grids) {
  auto loaded = VdbWriter().bundle(grids).load();
  if (!loaded) throw std::runtime_error(loaded.error().where + ": " + loaded.error().message);
  return std::move(*loaded);
}

/// Value of a voxel; 0 where there is none.
[[nodiscard]] inline float voxel(const Grid& grid, ivec3 at, u32 channel = 0) {
  const auto bricks = grid.bricks.span();
  const auto brick = std::ranges::find(bricks, at >> 3);
  if (brick == bricks.end()) return 0;
  const ivec3 in = at & 7;
  const auto row = std::size_t(brick - bricks.begin()) * kBrickVoxels +
                   std::size_t((in.x * 8 + in.y) * 8 + in.z);
  return grid.values[row * grid.channels + channel];
}

/// Calls with every voxel of a box that spans several bricks, on both sides of 0.
template <class Visit>
void each_voxel(const Visit& visit) {
  for (int x = -9; x < 7; ++x)
    for (int y = -3; y < 10; ++y)
      for (int z = 5; z < 18; ++z) visit(ivec3(x, y, z));
}
[[nodiscard]] inline int count_at(ivec3 at) { return (at.x * 7 + at.y * 3 + at.z * 5 + 200) % 16; }

/// A grid of what value(voxel) gives, active where that is not 0.
template <class GridType, class Value>
typename GridType::Ptr grid_of(const std::string& name, const Value& value) {
  auto grid = GridType::create();
  grid->setName(name);
  auto accessor = grid->getAccessor();
  each_voxel([&](ivec3 at) {
    if (count_at(at) != 0)
      accessor.setValueOn({at.x, at.y, at.z}, typename GridType::ValueType(value(count_at(at))));
  });
  return grid;
}

}  // namespace heliograph::test
