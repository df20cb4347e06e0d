#include "renderer/assets/volume_bricks.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "renderer/scene/grid.h"
#include "renderer/scene/invertible.h"

namespace heliograph::assets {

float* FileGrid::add_brick(ivec3 origin) {
  for (int i = 0; i < 3; ++i)
    if (origin[i] < -kLargestVoxel || origin[i] >= kLargestVoxel)
      refuse(name_, fmt::format("has voxels at {}; {} is the most", origin[i], kLargestVoxel));
  budget_->take(brick_size(), sizeof(float), name_);
  bricks_.push_back(origin >> 3);
  values_.resize(values_.size() + brick_size());
  return values_.data() + values_.size() - brick_size();
}

void FileGrid::add_tile(const Tile& tile, const float* value) {
  // The inside of a level set is -background.
  const bool zero = level_set ? !(value[0] < 0)
                              : !tile.active || std::all_of(value, value + channels_,
                                                            [](float v) { return v == 0; });
  if (zero) return;
  const u64 across = u64(tile.side / kBrickSide);
  Budget::check(across * across * across * brick_size() * sizeof(float), budget_->limits().bytes,
                "bytes", name_);
  for (i32 x = 0; x < tile.side; x += kBrickSide)
    for (i32 y = 0; y < tile.side; y += kBrickSide)
      for (i32 z = 0; z < tile.side; z += kBrickSide) {
        float* out = add_brick(tile.origin + ivec3(x, y, z));
        for (u32 i = 0; i < kBrickVoxels; ++i) std::copy_n(value, channels_, out + i * channels_);
      }
}

bool FileGrid::make_fog(float most) {
  if (!std::ranges::all_of(values_, [](float v) { return std::isfinite(v); }))
    refuse(name_, "holds a number that is NaN or infinite");
  bool clamped = false;
  const float scale = level_set && background > 0 ? -1 / background : 1;
  const float top = level_set ? 1 : most;
  for (float& value : values_) {
    const float v = value * scale;
    value = std::clamp(v, 0.0f, top);
    clamped = clamped || (!level_set && v != value);
  }
  return clamped;
}

Grid FileGrid::finish() {
  const vec3 origin = object_from_index[3];
  if (!invertible(object_from_index) || !std::isfinite(origin.x + origin.y + origin.z))
    refuse(name_, "has a transform that is not invertible");
  std::vector<u32> order(bricks_.size());
  std::iota(order.begin(), order.end(), 0u);
  std::erase_if(order, [&](u32 i) {
    const float* first = values_.data() + i * brick_size();
    return std::all_of(first, first + brick_size(), [](float v) { return v == 0; });
  });
  std::ranges::sort(order, [&](u32 a, u32 b) { return brick_before(bricks_[a], bricks_[b]); });
  const auto same = [&](u32 a, u32 b) { return bricks_[a] == bricks_[b]; };
  if (std::ranges::adjacent_find(order, same) != order.end())
    refuse(name_, "has two nodes in one place");
  Grid grid{.channels = channels_};
  budget_->take(order.size() * brick_size(), sizeof(float), name_);
  std::vector<ivec3> bricks;
  std::vector<float> values;
  values.reserve(order.size() * brick_size());
  ivec3 low(kLargestVoxel), high(-kLargestVoxel);
  for (const u32 i : order) {
    bricks.push_back(bricks_[i]);
    const float* first = values_.data() + i * brick_size();
    values.insert(values.end(), first, first + brick_size());
    for (u32 v = 0; v < brick_size(); ++v) {
      if (first[v] == 0) continue;
      const i32 n = i32(v / channels_);
      const ivec3 voxel = bricks_[i] * kBrickSide + ivec3(n >> 6, (n >> 3) & 7, n & 7);
      low = glm::min(low, voxel);
      high = glm::max(high, voxel);
    }
  }
  if (order.empty()) low = high = ivec3(0);
  grid.lower = low - 1;
  grid.upper = high + 2;
  if (brick_range(grid.lower, grid.upper).size() > kMostBricks)
    refuse(name_, "spans too many voxels; split it into several files", Code::kResourceExhausted);
  grid.bricks = ArrayOf<ivec3>(std::move(bricks));
  grid.values = ArrayOf<float>(std::move(values));
  // Sample i lies at the centre of our voxel i.
  grid.object_from_voxel = object_from_index;
  grid.object_from_voxel[3] = object_from_index * vec4(vec3(-0.5f), 1);
  bricks_.clear();
  values_ = {};
  return grid;
}

}  // namespace heliograph::assets
