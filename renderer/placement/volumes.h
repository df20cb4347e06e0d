// Volumes on the device: tables of their grids, and the entities that show them.
#pragma once

#include "renderer/placement/placement.h"

namespace heliograph::resident {

/// Table by which rays find a grid's bricks: a function of these and, for majorants, its values.
struct GridTable {
  std::vector<u32> bricks;       // by cell of the box
  std::vector<float> majorants;  // by cell; of grids of one channel
  [[nodiscard]] u64 bytes() const { return (bricks.size() + majorants.size()) * 4; }
};
[[nodiscard]] std::shared_ptr<const GridTable> grid_table(const Grid& grid, DerivedCache& cache);
[[nodiscard]] DerivedKey key_of(const Grid& grid);
/// True if grid_table() would find it made.
[[nodiscard]] bool grid_table_ready(const Grid& grid, const DerivedCache& cache);
/// The grid as kernels read it, but for where it is.
[[nodiscard]] kernels::GridView grid_view(const Grid& grid, const GridTable& table);

/// The grids of a volume, those it has.
[[nodiscard]] std::vector<const Grid*> grids_of(const Volume& volume);

struct Volumes {
  std::vector<kernels::VolumeView> views;  // in the order of Structure::volumes
  std::vector<kernels::VolumeNode> nodes;  // the tree over them
  std::vector<std::shared_ptr<const GridTable>> tables;
};
[[nodiscard]] std::shared_ptr<const Volumes> make_volumes(const Snapshot& snapshot,
                                                          const Placement& placement,
                                                          DerivedCache& cache);

}  // namespace heliograph::resident
