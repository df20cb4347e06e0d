// Volume files written by OpenVDB itself.
#pragma once

#include <openvdb/io/Archive.h>
#include <openvdb/openvdb.h>

#include <sstream>

#include "tests/unit/asset_fixture.h"
#include "tests/unit/voxels.h"

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
