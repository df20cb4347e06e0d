// A grid while a volume's file is read: index space as in OpenVDB, sample (i, j, k) at that place.
// Filled by the readers of .nvdb and .vdb, turned into a Grid by volume.cpp.
#pragma once

#include <string>
#include <vector>

#include "renderer/assets/budget.h"
#include "renderer/assets/bundle.h"
#include "renderer/scene/components.h"

namespace heliograph::assets {

/// Owns: the bricks so far, in any order.
class FileGrid {
 public:
  FileGrid(const std::string& name, u32 channels, Budget& budget)
      : name_(clean_name(name, "grid")), channels_(channels), budget_(&budget) {}

  bool level_set = false;
  float background = 0;  // first channel
  mat4x3 object_from_index{1};

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] u32 channels() const { return channels_; }

  /// Room for the kBrickVoxels * channels values of the brick whose first voxel is `origin`.
  [[nodiscard]] float* add_brick(ivec3 origin);
  /// The same value over a cube. What stays 0 takes no room: outside of level sets what is not
  /// active is left out.
  struct Tile {
    ivec3 origin;
    i32 side;  // voxels
    bool active;
  };
  void add_tile(const Tile& tile, const float* value);

  /// Level sets become fog: 0 at the surface, 1 from `background` inside on; of other grids values
  /// outside [0, most] are clamped. Says whether some were. Refuses numbers that are not finite.
  bool make_fog(float most);
  /// The sparse grid of what is not 0, its box a voxel wider, so that it fades to 0. `this` is
  /// empty afterwards.
  [[nodiscard]] Grid finish();

 private:
  [[nodiscard]] std::size_t brick_size() const { return std::size_t(kBrickVoxels) * channels_; }

  std::string name_;
  u32 channels_;
  Budget* budget_;
  std::vector<ivec3> bricks_;
  std::vector<float> values_;
};

/// The fields of a .nvdb or .vdb file that could be read; the names of the others in `skipped`.
struct VolumeFile {
  std::vector<FileGrid> grids;
  std::vector<std::string> skipped;  // "name (why)"
};
[[nodiscard]] VolumeFile read_nvdb(std::span<const std::byte> file, Budget& budget);
[[nodiscard]] VolumeFile read_vdb(std::span<const std::byte> file, Budget& budget);

}  // namespace heliograph::assets
