#include "renderer/assets/volume_trees.h"

#include <openvdb/tools/Interpolation.h>

#include <algorithm>
#include <cmath>

namespace heliograph::assets {
namespace {

namespace vdb = openvdb;

ivec3 to_glm(const vdb::Coord& at) { return {at.x(), at.y(), at.z()}; }

/// write_leaf() of the type that most files have, at once.
void copy_leaf(const void* node, float* out) {
  const auto& leaf = *static_cast<const vdb::FloatTree::LeafNodeType*>(node);
  std::copy_n(leaf.buffer().data(), kBrickVoxels, out);
}

template <class Tiles>
void add_tiles(Tiles tile, Bricks& bricks) {
  tile.setMaxDepth(Tiles::LEAF_DEPTH - 1);
  for (; tile; ++tile) {
    vdb::CoordBBox box;
    tile.getBoundingBox(box);
    bricks.add_tile(to_glm(box.min()), box.dim().x(), tile.isValueOn(), components(*tile));
  }
}

mat4x3 to_glm(const vdb::math::Transform& transform) {
  const vdb::Mat4d matrix = transform.baseMap()->getAffineMap()->getMat4();  // of row vectors
  mat4x3 m;
  for (int row = 0; row < 4; ++row)
    for (int i = 0; i < 3; ++i) m[row][i] = float(matrix(row, i));
  return m;
}

template <class GridType>
void use_bricks_of(const GridType& grid, const std::string& name, Budget& budget,
                   const VolumeFile::Use& use) {
  using Leaf = typename GridType::TreeType::LeafNodeType;
  using Value = typename GridType::ValueType;
  const bool level_set =
      std::is_floating_point_v<Value> && grid.getGridClass() == vdb::GRID_LEVEL_SET;
  const GridLook look{.channels = kChannelsOf<Value>,
                      .level_set = level_set,
                      .background = std::abs(components(grid.background())[0]),
                      .object_from_index = to_glm(grid.transform())};
  Bricks bricks(name, look, budget);
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf)
    bricks.add_leaf(to_glm(leaf->origin()), &*leaf);
  if (level_set) {
    add_tiles(grid.tree().cbeginValueAll(), bricks);
  } else {
    add_tiles(grid.tree().cbeginValueOn(), bricks);
  }
  use(bricks, std::is_same_v<Value, float> ? copy_leaf : write_leaf<Leaf>);
}

/// Box that a frustum covers, in voxels as large as those in the middle of what is active.
struct Box {
  vdb::math::Transform::Ptr transform;
  vdb::CoordBBox bricks;
};

Box box_of(const vdb::GridBase& grid, const std::string& name) {
  constexpr double kMostSampled = 1 << 18;  // bricks
  const vdb::CoordBBox active = grid.evalActiveVoxelBoundingBox();
  const vdb::Vec3d size = grid.transform().voxelSize(active.getCenter());
  const double voxel = std::min({size[0], size[1], size[2]});
  if (!(voxel > 0)) refuse(name, "has a transform that is not invertible");
  const vdb::BBoxd world = grid.transform().indexToWorld(active.expandBy(1));
  const vdb::Vec3d span = world.extents() / (voxel * kBrickSide) + 2.0;
  if (!(span[0] * span[1] * span[2] <= kMostSampled))
    refuse(name, "is a frustum of too many voxels; resample it into a box of fewer",
           Code::kResourceExhausted);
  const auto transform = vdb::math::Transform::createLinearTransform(voxel);
  const auto brick = [&](const vdb::Vec3d& at) {
    return vdb::Coord::floor(transform->worldToIndex(at) / double(kBrickSide));
  };
  return {transform, {brick(world.min()), brick(world.max())}};
}

template <class GridType>
typename GridType::Ptr resampled(const GridType& grid, const std::string& name) {
  using Leaf = typename GridType::TreeType::LeafNodeType;
  const Box box = box_of(grid, name);
  auto out = GridType::create(grid.background());
  out->setGridClass(grid.getGridClass());
  out->setTransform(box.transform);
  using Accessor = typename GridType::ConstAccessor;
  const Accessor accessor = grid.getConstAccessor();
  const vdb::tools::GridSampler<Accessor, vdb::tools::BoxSampler> sampler(accessor,
                                                                          grid.transform());
  for (auto brick = box.bricks.begin(); brick; ++brick) {
    auto leaf = std::make_unique<Leaf>((*brick) << 3, grid.background());
    bool shows = false;
    for (u32 i = 0; i < kBrickVoxels; ++i) {
      const auto value =
          sampler.wsSample(box.transform->indexToWorld(leaf->offsetToGlobalCoord(i)));
      leaf->setValueOn(i, value);
      shows |= value != grid.background();
    }
    if (shows) out->tree().addLeaf(leaf.release());
  }
  return out;
}

}  // namespace

u32 channels_of(const vdb::GridBase& grid) { return grid.valueType().starts_with("vec3") ? 3 : 1; }

void use_bricks(const vdb::GridBase& grid, const std::string& name, Budget& budget,
                const VolumeFile::Use& use) {
  const auto show = [&](const auto& typed) { use_bricks_of(typed, name, budget, use); };
  if (grid.transform().isLinear()) {
    grid.apply<ShownGrids>(show);
    return;
  }
  const bool resamples = grid.apply<vdb::TypeList<vdb::FloatGrid, vdb::Vec3SGrid>>(
      [&](const auto& typed) { show(*resampled(typed, name)); });
  if (!resamples)
    refuse_unimplemented(name,
                         fmt::format("a frustum of values of type {}; write them as float or vec3s",
                                     grid.valueType()));
}

}  // namespace heliograph::assets
