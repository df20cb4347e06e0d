// Grids to tables, volumes to views.
#include "renderer/placement/volumes.h"

#include <algorithm>

#include "renderer/derived/black_body.h"
#include "renderer/placement/volume_tree.h"
#include "renderer/scene/grid.h"

namespace heliograph::resident {
namespace {

/// Interpolation rounds; a majorant leaves room for it.
constexpr float kRoom = 1 + 0x1p-18f;

/// The voxels of a brick along one axis that a cell `offset` bricks away reads: half a voxel beyond
/// its faces lies the next centre.
struct Reach {
  i32 first, last;
};
constexpr Reach reach(i32 offset) {
  constexpr i32 kLast = kBrickSide - 1;
  return offset < 0 ? Reach{0, 0} : offset > 0 ? Reach{kLast, kLast} : Reach{0, kLast};
}

float largest(const float* brick, Reach x, Reach y, Reach z) {
  float most = 0;
  for (i32 i = x.first; i <= x.last; ++i)
    for (i32 j = y.first; j <= y.last; ++j)
      for (i32 k = z.first; k <= z.last; ++k)
        most = std::max(most, brick[(i * kBrickSide + j) * kBrickSide + k]);
  return most;
}

void add_majorants(const BrickRange& range, ivec3 at, const float* brick,
                   std::vector<float>& majorants) {
  for (i32 x = -1; x <= 1; ++x)
    for (i32 y = -1; y <= 1; ++y)
      for (i32 z = -1; z <= 1; ++z) {
        const ivec3 cell = at + ivec3(x, y, z) - range.first;
        if (glm::any(glm::lessThan(cell, ivec3(0))) ||
            glm::any(glm::greaterThanEqual(cell, range.count)))
          continue;
        float& majorant = majorants[range.row(cell + range.first)];
        majorant = std::max(majorant, largest(brick, reach(x), reach(y), reach(z)) * kRoom);
      }
}

kernels::VolumeView view_of(const Volume& volume) {
  kernels::VolumeView view{};
  view.density_scale = volume.density_scale;
  view.albedo = volume.albedo;
  view.anisotropy = volume.anisotropy;
  view.temperature_scale = volume.temperature_scale;
  const bool glows = volume.temperature && volume.temperature_scale > 0;
  view.emission_scale = glows ? volume.emission_scale : 0;
  return view;
}

kernels::BvhBox object_box(const Grid& density) {
  kernels::BvhBox box = kernels::no_box();
  for (const vec3& corner : box_corners(density)) box.extend(corner);
  return box;
}

}  // namespace

DerivedKey key_of(const Grid& grid) {
  const auto box = [&](int i) { return u64(u32(grid.lower[i])) << 32 | u32(grid.upper[i]); };
  return {Derived::kGrid, {grid.bricks.serial(), grid.values.serial(), box(0), box(1), box(2)}};
}

std::shared_ptr<const GridTable> grid_table(const Grid& grid, DerivedCache& cache) {
  return cache.get<GridTable>(key_of(grid), {grid.bricks.buffer(), grid.values.buffer()}, [&] {
    auto table = std::make_shared<GridTable>();
    const BrickRange range = brick_range(grid.lower, grid.upper);
    table->bricks.assign(range.size(), kNone);
    if (grid.channels == 1) table->majorants.assign(range.size(), 0);
    for (u32 i = 0; i < grid.bricks.size(); ++i) {
      table->bricks[range.row(grid.bricks[i])] = i;
      if (grid.channels == 1)
        add_majorants(range, grid.bricks[i], grid.values.data() + u64(i) * kBrickVoxels,
                      table->majorants);
    }
    return table;
  });
}

bool grid_table_ready(const Grid& grid, const DerivedCache& cache) {
  return cache.contains(key_of(grid));
}

kernels::GridView grid_view(const Grid& grid, const GridTable& table) {
  const BrickRange range = brick_range(grid.lower, grid.upper);
  return {.values = grid.values.data(),
          .bricks = table.bricks.data(),
          .majorants = table.majorants.data(),
          .first_cell = range.first,
          .cells = range.count,
          .lower = grid.lower,
          .upper = grid.upper,
          .voxel_from_object = inverse(grid.object_from_voxel)};
}

std::vector<const Grid*> grids_of(const Volume& volume) {
  std::vector<const Grid*> grids;
  for (const auto* grid : {&volume.density, &volume.temperature, &volume.color})
    if (*grid) grids.push_back(grid->get());
  return grids;
}

std::shared_ptr<const Volumes> make_volumes(const Snapshot& snapshot, const Placement& placement,
                                            DerivedCache& cache) {
  auto volumes = std::make_shared<Volumes>();
  std::vector<kernels::BvhBox> boxes;
  for (const kernels::InstanceView& instance : placement.volumes) {
    const Volume& volume = *snapshot.find(snapshot.entities.at(instance.entity).volume)->value;
    kernels::VolumeView view = view_of(volume);
    view.instance = instance;
    const auto take = [&](const std::shared_ptr<const Grid>& grid, kernels::GridView& out) {
      if (!grid) return;
      volumes->tables.push_back(grid_table(*grid, cache));
      out = grid_view(*grid, *volumes->tables.back());
    };
    take(volume.density, view.density);
    take(volume.temperature, view.temperature);
    take(volume.color, view.color);
    volumes->views.push_back(view);
    boxes.push_back(ray_box(instance, placement.motion_keys.data(), object_box(*volume.density)));
  }
  volumes->nodes = make_volume_tree(boxes);
  return volumes;
}

}  // namespace heliograph::resident
