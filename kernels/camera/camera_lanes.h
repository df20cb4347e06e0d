// A camera's rays through the pixels of a patch, in lanes. Called by lockstep.h.
#pragma once

#include "kernels/camera/camera.h"
#include "kernels/camera/filter.h"
#include "kernels/core/lanes.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// True if these are all the rays of a camera: it stands still and neither blurs nor bends them.
KERNEL bool is_plain(const CameraView& camera) {
  return camera.segments == 0 && !(camera.aperture.radius > 0) &&
         camera.lens.projection == Projection::kPerspective && !camera.lens.distorted;
}

inline Floats inverse_erf(Floats x) {
  for (u32 i = 0; i < kLanes; ++i) x.v[i] = inverse_erf(float(x.v[i]));
  return x;
}

struct CameraLanes {
  Row x, y;  // pixel
  Row u, v;  // uniform in [0, 1): where in the filter
  Row3 origin, direction;
  Row end;  // Ray::t_max
};

/// camera_ray() of a plain camera, through a place that the filter chooses.
KERNEL void set_rays(const CameraView& camera, PixelFilter filter, CameraLanes& rays) {
  const Vec2<Floats> offset = sample_filter(filter, Vec2<Floats>(rays.u, rays.v));
  const Vec2<Floats> raster(Floats(rays.x) + 0.5f + offset.x, Floats(rays.y) + 0.5f + offset.y);
  const Vec2<Floats> m = image_place(camera, raster);
  const Vec3<Floats> direction = ray_direction(camera, Vec3<Floats>(m.x, m.y, 1));
  Vec3<Floats> origin(camera.world_from_camera[3]);
  Floats end(INFINITY);
  clip(camera, direction, origin, end);
  rays.origin = origin;
  rays.direction = direction;
  rays.end = end;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
