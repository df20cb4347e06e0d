#include "renderer/backend/embree/host_tracer.h"

#include <algorithm>
#include <bit>

namespace heliograph::embree {

u32 EmbreeHostTracer::meets_of(u32 instance, const host::RayPacket& rays, u32 lanes) const {
  alignas(32) int valid[host::RayPacket::kRays];
  for (u32 i = 0; i < host::RayPacket::kRays; ++i) {
    const bool sound = kernels::is_sound(rays.ray(i), kernels::kFarthest, kernels::kFarthest);
    valid[i] = lanes >> i & 1 && sound ? -1 : 0;
  }
  RTCRay8 query;
  std::ranges::copy(rays.origin_x, query.org_x);
  std::ranges::copy(rays.origin_y, query.org_y);
  std::ranges::copy(rays.origin_z, query.org_z);
  std::ranges::copy(rays.t_min, query.tnear);
  std::ranges::copy(rays.direction_x, query.dir_x);
  std::ranges::copy(rays.direction_y, query.dir_y);
  std::ranges::copy(rays.direction_z, query.dir_z);
  std::ranges::fill(query.time, rays.time);
  std::ranges::copy(rays.t_max, query.tfar);
  std::ranges::fill(query.mask, kNone);
  std::ranges::fill(query.id, 0u);
  std::ranges::fill(query.flags, 0u);
  u32 met = tracer_.meets(instance, query, valid);
  // Where the neighbours of a ray met the instance, or are not asked for, it may have slipped
  // through.
  const u32 others = met | ~lanes;
  for (u32 alone = ~others & (others << 1 | 1) & (others >> 1 | 0x80); alone; alone &= alone - 1) {
    const u32 i = u32(std::countr_zero(alone));
    met |= u32(valid[i] && meets_after_all(scene_, instance, rays.ray(i))) << i;
  }
  return met;
}

}  // namespace heliograph::embree
