#include "renderer/host/tracer.h"

namespace heliograph::host {

u32 HostTracer::meets_of(u32 instance, const RayPacket& rays, u32 lanes) const {
  u32 met = 0;
  for (u32 i = 0; i < RayPacket::kRays; ++i) {
    if (!(lanes >> i & 1)) continue;
    const kernels::Ray ray{{rays.origin_x[i], rays.origin_y[i], rays.origin_z[i]},
                           {rays.direction_x[i], rays.direction_y[i], rays.direction_z[i]},
                           rays.t_max[i],
                           rays.time,
                           {.key = 0, .probe = true}};
    met |= u32(meets(instance, ray)) << i;
  }
  return met;
}

}  // namespace heliograph::host
