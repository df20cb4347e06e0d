#include "renderer/backend/embree/host_tracer.h"

#include <algorithm>

namespace heliograph::embree {

u32 EmbreeHostTracer::meets_of(u32 instance, const host::RayPacket& rays, u32 lanes) const {
  alignas(32) int valid[host::RayPacket::kRays];
  for (u32 i = 0; i < host::RayPacket::kRays; ++i) {
    const kernels::Ray ray{{rays.origin_x[i], rays.origin_y[i], rays.origin_z[i]},
                           {rays.direction_x[i], rays.direction_y[i], rays.direction_z[i]},
                           rays.t_max[i],
                           rays.time,
                           {}};
    valid[i] =
        lanes >> i & 1 && kernels::is_sound(ray, kernels::kFarthest, kernels::kFarthest) ? -1 : 0;
  }
  RTCRay8 query;
  std::ranges::copy(rays.origin_x, query.org_x);
  std::ranges::copy(rays.origin_y, query.org_y);
  std::ranges::copy(rays.origin_z, query.org_z);
  std::ranges::fill(query.tnear, 0.0f);
  std::ranges::copy(rays.direction_x, query.dir_x);
  std::ranges::copy(rays.direction_y, query.dir_y);
  std::ranges::copy(rays.direction_z, query.dir_z);
  std::ranges::fill(query.time, rays.time);
  std::ranges::copy(rays.t_max, query.tfar);
  std::ranges::fill(query.mask, kNone);
  std::ranges::fill(query.id, 0u);
  std::ranges::fill(query.flags, 0u);
  return tracer_.meets(instance, query, valid);
}

}  // namespace heliograph::embree
