#include "renderer/host/tracer.h"

namespace heliograph::host {

u32 HostTracer::meets_of(u32 instance, const RayPacket& rays, u32 lanes) const {
  u32 met = 0;
  for (u32 i = 0; i < RayPacket::kRays; ++i)
    if (lanes >> i & 1) met |= u32(meets(instance, rays.ray(i))) << i;
  return met;
}

}  // namespace heliograph::host
