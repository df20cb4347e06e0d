// Sparse grids: looking a field up, and walking a ray through its cells with their majorants.
// Called by volume.h.
#pragma once

#include "kernels/core/math.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

// ---------------------------------------------------------------- looking up

KERNEL ivec3 clamp_to(ivec3 v, ivec3 low, ivec3 high) { return glm::min(glm::max(v, low), high); }

/// Row of a cell in the grid's table.
KERNEL u64 cell_row(const GridView& grid, ivec3 cell) {
  const ivec3 at = cell - grid.first_cell;
  return (u64(at.x) * u32(grid.cells.y) + u32(at.y)) * u32(grid.cells.z) + u32(at.z);
}

/// The numbers of a voxel of the box; null: all 0.
template <int Channels>
KERNEL const float* voxel_at(const GridView& grid, ivec3 voxel) {
  const u32 brick = grid.bricks[cell_row(grid, voxel >> 3)];
  if (brick == kNone) return nullptr;
  const ivec3 at = voxel & (kBrickSide - 1);
  return grid.values +
         (u64(brick) * kBrickVoxels + u32((at.x * kBrickSide + at.y) * kBrickSide + at.z)) *
             Channels;
}

/// Numbers of a grid at one place.
template <int Channels>
struct Values {
  float channel[Channels];
};

/// The field at a point in voxel coordinates: interpolated between the voxels' centres, constant
/// beyond the outermost ones.
template <int Channels>
KERNEL Values<Channels> interpolate_grid(const GridView& grid, vec3 p) {
  p = glm::min(glm::max(p, vec3(grid.lower)), vec3(grid.upper));
  const vec3 base = glm::floor(p - 0.5f);
  const vec3 w = p - 0.5f - base;
  const ivec3 last = grid.upper - 1;
  const ivec3 corner[2] = {clamp_to(ivec3(base), grid.lower, last),
                           clamp_to(ivec3(base) + 1, grid.lower, last)};
  Values<Channels> sum{};
  const auto add = [&](const float* voxel, u32 i) {
    if (!voxel) return;
    const float weight =
        (i & 4 ? w.x : 1 - w.x) * (i & 2 ? w.y : 1 - w.y) * (i & 1 ? w.z : 1 - w.z);
    for (int c = 0; c < Channels; ++c) sum.channel[c] += weight * voxel[c];
  };
  if ((corner[0] >> 3) == (corner[1] >> 3)) {  // one brick has them all
    const float* first = voxel_at<Channels>(grid, corner[0]);
    if (!first) return sum;
    const ivec3 step =
        (corner[1] - corner[0]) * ivec3(kBrickSide * kBrickSide, kBrickSide, 1) * Channels;
    for (u32 i = 0; i < 8; ++i) {
      add(first + (i & 4 ? step.x : 0) + (i & 2 ? step.y : 0) + (i & 1 ? step.z : 0), i);
    }
    return sum;
  }
  for (u32 i = 0; i < 8; ++i) {
    const ivec3 voxel(corner[(i >> 2) & 1].x, corner[(i >> 1) & 1].y, corner[i & 1].z);
    add(voxel_at<Channels>(grid, voxel), i);
  }
  return sum;
}

// ---------------------------------------------------------------- rays

/// A ray in voxel coordinates; its parameter stays metres along the world's ray.
struct GridRay {
  vec3 origin;
  vec3 direction;
  KERNEL vec3 at(float t) const { return origin + direction * t; }
};

KERNEL GridRay to_grid(const mat4x3& voxel_from_object, const GridRay& ray_object) {
  return {transform_point(voxel_from_object, ray_object.origin),
          transform_vector(voxel_from_object, ray_object.direction)};
}

/// Part of a ray, metres; empty unless begin < end.
struct Span {
  float begin;
  float end;
};

/// Where a ray is within a box, between 0 and t_max.
///
/// Source: Kay and Kajiya 1986, "Ray Tracing Complex Scenes", section 3 (slabs).
KERNEL Span span_in_box(vec3 lower, vec3 upper, vec3 origin, vec3 direction, float t_max) {
  Span span{0, t_max};
  for (int i = 0; i < 3; ++i) {
    if (direction[i] == 0) {
      if (origin[i] < lower[i] || origin[i] > upper[i]) return {0, 0};
      continue;
    }
    const float inverse = 1 / direction[i];
    const float a = (lower[i] - origin[i]) * inverse;
    const float b = (upper[i] - origin[i]) * inverse;
    span.begin = max2(span.begin, min2(a, b));
    span.end = min2(span.end, max2(a, b));
  }
  return span;
}
/// The same of the grid's box.
KERNEL Span span_in_box(const GridView& grid, const GridRay& ray, float t_max) {
  return span_in_box(vec3(grid.lower), vec3(grid.upper), ray.origin, ray.direction, t_max);
}

/// A walk through the cells that a span of a ray crosses.
///
/// Source: Amanatides and Woo 1987, "A Fast Voxel Traversal Algorithm for Ray Tracing".
class CellWalk {
 public:
  KERNEL CellWalk(const GridView& grid, const GridRay& ray, Span span)
      : grid_(&grid), t_(span.begin), end_(span.end) {
    const vec3 start = ray.at(span.begin);
    constexpr float kInverseSide = 1.0f / kBrickSide;
    const ivec3 last = grid.first_cell + grid.cells - 1;
    cell_ = clamp_to(ivec3(glm::floor(start * kInverseSide)), grid.first_cell, last);
    for (int i = 0; i < 3; ++i) {
      const float d = ray.direction[i];
      step_[i] = d < 0 ? -1 : 1;
      const float plane = float((cell_[i] + (d < 0 ? 0 : 1)) * kBrickSide);
      next_[i] = d == 0 ? INFINITY : (plane - ray.origin[i]) / d;
      delta_[i] = d == 0 ? INFINITY : float(kBrickSide) / std::fabs(d);
    }
  }

  /// The part of the ray in the next cell, and the cell's row in the grid's table; false at the
  /// end of the span.
  KERNEL bool next(Span& span, u64& row) {
    if (!(t_ < end_)) return false;
    const int axis =
        next_.x <= next_.y ? (next_.x <= next_.z ? 0 : 2) : (next_.y <= next_.z ? 1 : 2);
    row = cell_row(*grid_, cell_);
    span = {t_, min2(max2(next_[axis], t_), end_)};
    t_ = span.end;
    cell_[axis] += step_[axis];
    next_[axis] += delta_[axis];
    const i32 at = cell_[axis] - grid_->first_cell[axis];
    if (at < 0 || at >= grid_->cells[axis]) {
      // Rounding may leave a rest of the span behind the last cell: it belongs to that one.
      cell_[axis] -= step_[axis];
      next_[axis] = INFINITY;
    }
    return true;
  }

 private:
  const GridView* grid_;
  ivec3 cell_, step_;
  vec3 next_, delta_;
  float t_, end_;
};

}  // namespace heliograph::kernels::inline HELIO_ISA
