// Bricks of 8^3 voxels on their way from a file's tree to a Grid. Index space is that of OpenVDB:
// sample (i, j, k) lies at that place. Used by the readers of .nvdb and .vdb.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "renderer/assets/budget.h"
#include "renderer/scene/components.h"

namespace heliograph::assets {

/// Channels of a value of either library: a number, or a vector of three.
template <class Value>
constexpr u32 kChannelsOf = requires(Value value) { value[0]; } ? 3 : 1;
template <class Value>
std::array<float, 3> components(const Value& value) {
  if constexpr (kChannelsOf<Value> == 3) {
    return {float(value[0]), float(value[1]), float(value[2])};
  } else {
    return {float(value)};
  }
}
/// The values of a library's leaf, one by one.
template <class Leaf>
void write_leaf(const void* node, float* out) {
  constexpr u32 kChannels = kChannelsOf<typename Leaf::ValueType>;
  const Leaf& leaf = *static_cast<const Leaf*>(node);
  for (u32 i = 0; i < kBrickVoxels; ++i)
    std::copy_n(components(leaf.getValue(i)).data(), kChannels, out + i * kChannels);
}

/// Meaning of a grid's values, and their place.
struct GridLook {
  u32 channels = 1;
  bool level_set = false;
  float background = 0;  // first channel
  mat4x3 object_from_index{1};
};

/// A grid as scenes have it, and what its warnings are about.
struct FileGrid {
  GridLook look;
  Grid grid;
  bool clamped = false;
};

/// Owns: where bricks are, not their values. Memory is paid for as leaves are added, and tiles
/// become bricks.
class Bricks {
 public:
  Bricks(std::string name, const GridLook& look, Budget& budget)
      : name_(std::move(name)), look_(look), budget_(&budget) {}

  /// A node of 8^3 voxels whose first is `origin`; it is read when the grid is made.
  void add_leaf(ivec3 origin, const void* leaf);
  /// The same value over a cube of `side` voxels. What stays 0 takes no room: outside of level sets
  /// what is not active is left out.
  void add_tile(ivec3 origin, i32 side, bool active, std::array<float, 3> value);

  /// Writes the kBrickVoxels * channels values of a leaf.
  using Read = std::function<void(const void* leaf, float* out)>;
  /// The sparse grid of what is not 0, its box a voxel wider, so that it fades to 0. Level sets
  /// become fog: 0 at the surface, 1 from the background's value inside on; of other grids values
  /// outside [0, most] are clamped. Refuses numbers that are not finite.
  [[nodiscard]] FileGrid make(const Read& read, float most);
  [[nodiscard]] const GridLook& look() const { return look_; }
  /// Calls with the first voxel and the values of each leaf.
  void each_leaf(const Read& read,
                 const std::function<void(ivec3 origin, std::span<const float>)>& visit) const;

 private:
  struct Brick {
    ivec3 at;
    const void* leaf;            // null: `value` everywhere
    std::array<float, 3> value;  // of `channels` numbers
  };

  [[nodiscard]] std::size_t brick_size() const {
    return std::size_t(kBrickVoxels) * look_.channels;
  }
  struct Tile {
    ivec3 origin;
    i32 side;  // voxels
    std::array<float, 3> value;
  };

  void check_place(ivec3 origin, i32 side) const;
  void expand();
  void sort();
  bool make_fog(std::span<float> brick, float most) const;
  void place(Grid& grid, ivec3 low, ivec3 high) const;

  std::string name_;
  GridLook look_;
  Budget* budget_;
  std::vector<Brick> bricks_;
  std::vector<Tile> tiles_;
};

}  // namespace heliograph::assets
