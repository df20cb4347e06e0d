// Rays of cameras that have one for each pixel: scanners, and lenses that no model describes.
// Called by camera.h.
#pragma once

#include "kernels/core/math.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

KERNEL bool sees(const TableRay& ray) { return dot(ray.direction, ray.direction) > 0; }

/// Between four rays of pixels, by their weights along x and y; outside of [0, 1] what they tend
/// to.
KERNEL TableRay mix(const TableRay (&of)[4], vec2 w) {
  const float weights[4] = {(1 - w.x) * (1 - w.y), w.x * (1 - w.y), (1 - w.x) * w.y, w.x * w.y};
  TableRay ray{vec3(0), vec3(0)};
  for (u32 i = 0; i < 4; ++i) {
    ray.origin += of[i].origin * weights[i];
    ray.direction += normalize(of[i].direction) * weights[i];
  }
  return ray;
}

/// The ray at a raster position in an image of `size` pixels: that of the pixel there, or, where
/// the table is interpolated, what lies between the centres of four of which each sees something.
HELIO_GPU_NOINLINE KERNEL TableRay table_ray(const RayTableView& table, uvec2 size, vec2 raster) {
  constexpr float kFilterReach = 2;  // pixels, no less than that of any filter
  const vec2 last(float(size.x - 1), float(size.y - 1));
  const float beyond = table.interpolated ? kFilterReach : 0;
  if (!(raster.x >= -beyond && raster.y >= -beyond && raster.x <= last.x + 1 + beyond &&
        raster.y <= last.y + 1 + beyond))
    return {vec3(0), vec3(0)};
  const auto at = [&](float x, float y) {
    return table.rays[u64(min2(max2(y, 0.0f), last.y)) * size.x + u64(min2(max2(x, 0.0f), last.x))];
  };
  const TableRay own = at(std::floor(raster.x), std::floor(raster.y));
  if (!table.interpolated || size.x < 2 || size.y < 2) return own;
  const vec2 place = raster - 0.5f;
  const vec2 corner(min2(max2(std::floor(place.x), 0.0f), last.x - 1),
                    min2(max2(std::floor(place.y), 0.0f), last.y - 1));
  const TableRay around[4] = {at(corner.x, corner.y), at(corner.x + 1, corner.y),
                              at(corner.x, corner.y + 1), at(corner.x + 1, corner.y + 1)};
  for (const TableRay& ray : around)
    if (!sees(ray)) return own;
  return mix(around, place - corner);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
