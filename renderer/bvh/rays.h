// Rays of the host through the kernels' BVH, compiled once for each x86-64 level and chosen at run
// time. Called by host_tracer.cpp.
#pragma once

#include "kernels/bvh/bvh.h"
#include "kernels/scene/ray.h"
#include "renderer/host/ray_packet.h"

namespace heliograph::bvh {

/// Scene and tree that rays go through.
struct TracedViews {
  const kernels::SceneView* scene;
  const kernels::BvhView* bvh;
};

/// The functions of a HostTracer.
struct RayFunctions {
  kernels::Hit (*closest)(const TracedViews&, const kernels::Ray&, kernels::u32 mask);
  bool (*occluded)(const TracedViews&, const kernels::Ray&, kernels::u32 mask);
  kernels::Hit (*closest_in)(const TracedViews&, kernels::u32 instance, const kernels::Ray&);
  bool (*meets)(const TracedViews&, kernels::u32 instance, const kernels::Ray&);
  kernels::u32 (*meets_of)(const TracedViews&, kernels::u32 instance, const host::RayPacket&,
                           kernels::u32 lanes);
};
extern const RayFunctions kRaysV2;
extern const RayFunctions kRaysV3;

/// The best level this processor has.
[[nodiscard]] const RayFunctions& best_rays();

}  // namespace heliograph::bvh
