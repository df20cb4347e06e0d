// Beginning of a path: its time, the camera's ray and the cone of its pixel. Called by path.h
// and the drivers.
#pragma once

#include "kernels/bsdf/blur.h"
#include "kernels/camera/camera.h"
#include "kernels/camera/filter.h"
#include "kernels/camera/rolling.h"
#include "kernels/integrator/path_state.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// The time of a path through pixel (x, y): stratified over the pixel's samples.
KERNEL float path_time(const CameraView& camera, const Sampler& sampler, u32 x, u32 y) {
  const float length = camera.shutter.length;
  return pixel_time(camera, x, y) + length * (length > 0 ? sampler.get1(kTimePair) : 0);
}

/// Where on the raster a sample of a pixel looks: the filter chooses, but for a table whose pixels
/// look along their own rays alone.
template <Tracer T>
KERNEL vec2 raster_place(const PathContext<T>& c, u32 x, u32 y) {
  if (c.camera.table.rays && !c.camera.table.interpolated) return centre_of(x, y);
  return centre_of(x, y) + sample_filter(c.settings.filter, c.sampler.get2(kFilterPair));
}

/// The ray of the camera that a sample of a pixel begins with.
template <Tracer T>
KERNEL Ray first_ray(const PathContext<T>& c, u32 x, u32 y) {
  const vec2 raster = raster_place(c, x, y);
  const HoleKey holes = hole_key(c, kHoleHash);
  return c.camera.aperture.radius > 0
             ? thin_lens_ray(c.camera, raster, c.sampler.get2(kLensPair), holes)
             : camera_ray(c.camera, raster, holes);
}

/// The cone of a pixel.
KERNEL Cone pixel_cone(const CameraView& camera) {
  if (camera.table.rays) return {camera.table.width, camera.table.spread};
  const float size = 1 / max2(camera.fx, camera.fy);
  return is_parallel(camera.lens.projection) ? Cone{size, 0} : Cone{0, size};
}

}  // namespace heliograph::kernels::inline HELIO_ISA
