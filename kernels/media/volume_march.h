// Which volume a pixel shows: deterministic marching, without random numbers. Called by probe.h and
// by backends for silhouettes.
#pragma once

#include "kernels/media/volume.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// As many volumes on one ray are looked at; of more, those that may be optically thickest.
inline constexpr u32 kMostMarched = 16;
/// A ray is marched in steps of half a voxel of the finest of these, but in so many at most.
inline constexpr u32 kMostMarchSteps = 4096;

/// A volume on a ray, cut to the cells that are not empty.
struct Marched {
  u32 volume;
  GridRay ray;  // of the density
  Span span;
  float bound;  // no less than the optical depth
};

KERNEL Marched make_marched(const SceneView& scene, u32 index, const Ray& world, float t_max) {
  const VolumeView& volume = scene.volumes[index];
  const GridView& grid = volume.density;
  const GridRay ray = to_grid(grid.voxel_from_object, to_volume(scene, volume, world));
  Marched m{index, ray, {INFINITY, 0}, 0};
  CellWalk walk(grid, ray, span_in_box(grid, ray, t_max));
  Span span;
  for (u64 row; walk.next(span, row);) {
    const float majorant = grid.majorants[row] * volume.density_scale;
    if (!(majorant > 0)) continue;
    m.span = {min2(m.span.begin, span.begin), span.end};
    m.bound += majorant * (span.end - span.begin);
  }
  return m;
}

/// The volumes on a ray.
struct MarchedSet {
  Marched volumes[kMostMarched];
  u32 count = 0;
  KERNEL void add(const Marched& m) {
    u32 least = 0;
    for (u32 i = 1; i < count; ++i) least = volumes[i].bound < volumes[least].bound ? i : least;
    if (count < kMostMarched) {
      volumes[count++] = m;
    } else if (m.bound > volumes[least].bound) {
      volumes[least] = m;
    }
  }
};

/// Extinction where the ray is at t, 1/m, and the volume with most of it, of equals the first.
struct MarchPoint {
  float extinction;
  u32 volume;
};
KERNEL MarchPoint march_point(const SceneView& scene, const MarchedSet& set, float t) {
  MarchPoint point{0, kNone};
  float most = 0;
  for (u32 i = 0; i < set.count; ++i) {
    const Marched& m = set.volumes[i];
    if (t < m.span.begin || t > m.span.end) continue;
    const float own = extinction_at(scene.volumes[m.volume], m.ray, t);
    point.extinction += own;
    if (own > most || (own == most && own > 0 && m.volume < point.volume)) {
      most = own;
      point.volume = m.volume;
    }
  }
  return point;
}

/// Where the transmittance of a set of volumes first is one half, and the volume with most
/// extinction there; volume kNone: nowhere.
KERNEL Collision march(const SceneView& scene, const MarchedSet& set) {
  constexpr float kHalf = 0.69314718f;  // optical depth, ln 2
  Span span{INFINITY, 0};
  float bound = 0;
  float finest = INFINITY;
  for (u32 i = 0; i < set.count; ++i) {
    const Marched& m = set.volumes[i];
    span = {min2(span.begin, m.span.begin), max2(span.end, m.span.end)};
    bound += m.bound;
    finest = min2(finest, 0.5f / length(m.ray.direction));
  }
  if (!(bound >= kHalf)) return {kNone, INFINITY};
  const float range = span.end - span.begin;
  const u32 steps = u32(min2(std::ceil(range / finest), float(kMostMarchSteps)));
  const float step = range / float(steps);
  float depth = 0;
  for (u32 i = 0; i < steps; ++i) {
    const float begin = span.begin + float(i) * step;
    const MarchPoint point = march_point(scene, set, begin + 0.5f * step);
    if (depth + point.extinction * step < kHalf) {
      depth += point.extinction * step;
      continue;
    }
    return {point.volume, begin + (kHalf - depth) / point.extinction};
  }
  return {kNone, INFINITY};
}

/// Where the volumes that camera rays meet bring the transmittance of a ray to one half before
/// t_max.
HELIO_GPU_NOINLINE KERNEL Collision half_way(const SceneView& scene, const Ray& ray, float t_max) {
  MarchedSet set;
  visit_volumes(scene, ray, kCameraRay, t_max, [&](u32 i, float&) {
    const Marched m = make_marched(scene, i, ray, t_max);
    if (m.bound > 0) set.add(m);
    return true;
  });
  return march(scene, set);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
