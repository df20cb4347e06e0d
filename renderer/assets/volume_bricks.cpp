#include "renderer/assets/volume_bricks.h"

#include <algorithm>
#include <cmath>

#include "renderer/scene/grid.h"
#include "renderer/scene/invertible.h"

namespace heliograph::assets {
namespace {

bool is_zero(std::span<const float> values) {
  return std::ranges::all_of(values, [](float v) { return v == 0; });
}

/// The box of the voxels that are not 0. Bricks within it are not looked at.
struct Box {
  ivec3 low{kLargestVoxel}, high{-kLargestVoxel};

  void add(ivec3 brick, std::span<const float> values, u32 channels) {
    const ivec3 first = brick * kBrickSide, last = first + kBrickSide - 1;
    if (glm::all(glm::lessThanEqual(low, first)) && glm::all(glm::lessThanEqual(last, high)))
      return;
    for (u32 v = 0; v < values.size(); ++v) {
      if (values[v] == 0) continue;
      const i32 n = i32(v / channels);
      const ivec3 voxel = first + ivec3(n >> 6, (n >> 3) & 7, n & 7);
      low = glm::min(low, voxel);
      high = glm::max(high, voxel);
    }
  }
};

}  // namespace

void Bricks::check_place(ivec3 origin, i32 side) const {
  for (int i = 0; i < 3; ++i)
    if (origin[i] < -kLargestVoxel || origin[i] > kLargestVoxel - side)
      refuse(name_, fmt::format("has voxels at {}; {} is the most", origin[i], kLargestVoxel));
}

void Bricks::add_leaf(ivec3 origin, const void* leaf) {
  check_place(origin, kBrickSide);
  budget_->take(brick_size(), sizeof(float), name_);
  bricks_.push_back({origin >> 3, leaf, {}});
}

void Bricks::add_tile(ivec3 origin, i32 side, bool active, std::array<float, 3> value) {
  // The inside of a level set is -background.
  const bool zero =
      look_.level_set ? !(value[0] < 0) : !active || is_zero({value.data(), look_.channels});
  if (zero) return;
  check_place(origin, side);
  tiles_.push_back({origin, side, value});
}

void Bricks::expand() {
  for (const Tile& tile : tiles_) {
    const i32 across = tile.side / kBrickSide;
    budget_->take(u64(across) * u64(across) * u64(across) * brick_size(), sizeof(float), name_);
    const ivec3 first = tile.origin >> 3;
    for (i32 x = 0; x < across; ++x)
      for (i32 y = 0; y < across; ++y)
        for (i32 z = 0; z < across; ++z)
          bricks_.push_back({first + ivec3(x, y, z), nullptr, tile.value});
  }
  tiles_.clear();
}

void Bricks::each_leaf(
    const Read& read,
    const std::function<void(ivec3 origin, std::span<const float>)>& visit) const {
  std::vector<float> values(brick_size());
  for (const Brick& brick : bricks_) {
    if (!brick.leaf) continue;
    read(brick.leaf, values.data());
    visit(brick.at * kBrickSide, values);
  }
}

void Bricks::sort() {
  std::ranges::sort(bricks_, brick_before, &Brick::at);
  if (std::ranges::adjacent_find(bricks_, {}, &Brick::at) != bricks_.end())
    refuse(name_, "has two nodes in one place");
}

bool Bricks::make_fog(std::span<float> brick, float most) const {
  const bool level_set = look_.level_set;
  const float scale = level_set && look_.background > 0 ? -1 / look_.background : 1;
  const float top = level_set ? 1 : most;
  bool finite = true, clamped = false;
  for (float& value : brick) {
    const float v = value * scale;
    finite &= std::isfinite(value);
    value = std::clamp(v, 0.0f, top);
    clamped |= v != value;
  }
  if (!finite) refuse(name_, "holds a number that is NaN or infinite");
  return clamped && !level_set;
}

FileGrid Bricks::make(const Read& read, float most) {
  expand();
  sort();
  FileGrid made{.look = look_, .grid = {.channels = look_.channels}};
  std::vector<ivec3> kept;
  std::vector<float> values(bricks_.size() * brick_size());
  Box box;
  for (const Brick& brick : bricks_) {
    const std::span<float> out(values.data() + kept.size() * brick_size(), brick_size());
    if (brick.leaf) {
      read(brick.leaf, out.data());
    } else {
      for (std::size_t i = 0; i < out.size(); ++i) out[i] = brick.value[i % look_.channels];
    }
    made.clamped |= make_fog(out, most);
    if (is_zero(out)) continue;
    kept.push_back(brick.at);
    box.add(brick.at, out, look_.channels);
  }
  values.resize(kept.size() * brick_size());
  if (kept.empty()) box.low = box.high = ivec3(0);
  made.grid.bricks = ArrayOf<ivec3>(std::move(kept));
  made.grid.values = ArrayOf<float>(std::move(values));
  place(made.grid, box.low, box.high);
  return made;
}

void Bricks::place(Grid& grid, ivec3 low, ivec3 high) const {
  const vec3 origin = look_.object_from_index[3];
  if (!invertible(look_.object_from_index) || !std::isfinite(origin.x + origin.y + origin.z))
    refuse(name_, "has a transform that is not invertible");
  grid.lower = low - 1;
  grid.upper = high + 2;
  if (brick_range(grid.lower, grid.upper).size() > kMostBricks)
    refuse(name_, "spans too many voxels; split it into several files", Code::kResourceExhausted);
  // Sample i lies at the centre of our voxel i.
  grid.object_from_voxel = look_.object_from_index;
  grid.object_from_voxel[3] = look_.object_from_index * vec4(vec3(-0.5f), 1);
}

}  // namespace heliograph::assets
