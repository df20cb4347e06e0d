// Rolling shutters and scans: when a camera sees a pixel, and in which row it sees a thing. Called
// by first_ray.h, probe.h and by a backend's labels.
#pragma once

#include "kernels/camera/camera.h"
#include "kernels/geometry/motion.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Time when a camera starts to see pixel (x, y).
KERNEL float pixel_time(const CameraView& camera, u32 x, u32 y) {
  const float time = camera.shutter.open + camera.shutter.row * float(y);
  if (!camera.table.times) return time;
  return time + camera.shutter.seconds * camera.table.times[u64(y) * camera.width + x];
}

/// When a camera starts to see what is at raster.y; what is beyond the image, with its first or
/// last row.
KERNEL float row_time(const CameraView& camera, float y) {
  const float row = min2(max2(y - 0.5f, 0.0f), float(camera.height) - 1);
  return camera.shutter.open + camera.shutter.row * row;
}

/// Where a camera sees something, and when.
struct Sighting {
  Projected at;
  float time;
  bool found;  // otherwise no row sees it when it is there, or many do
};

/// project_at(camera at a time) gives where it would be seen then. y: raster, where to begin.
///
/// The row depends on the time and the time on the row: a fixed point, which is reached while
/// things move more slowly over the image than its rows are read.
template <class F>
KERNEL Sighting find_row(const CameraView& camera, float y, F&& project_at) {
  constexpr u32 kSteps = 16;
  constexpr float kNear = 4e-3f;  // pixels
  Sighting s{};
  for (u32 i = 0; i < kSteps && !s.found; ++i) {
    s.time = row_time(camera, y);
    const CameraAt now(camera, s.time);
    s.at = project_at(now.camera());
    s.found = !s.at.seen || camera.shutter.row == 0 || std::fabs(s.at.raster.y - y) < kNear;
    y = s.at.raster.y;
  }
  return s;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
