// The functions themselves. Included by the translation unit of each level, which defines
// HELIO_ISA.
#pragma once

#include "renderer/bvh/packet_walk.h"
#include "renderer/bvh/rays.h"

namespace heliograph::bvh::inline HELIO_ISA {

inline kernels::BvhTracerFor<kernels::Answers::kLabels> tracer_of(const TracedViews& views) {
  return {*views.scene, *views.bvh};
}

inline kernels::Hit closest(const TracedViews& views, const kernels::Ray& ray, u32 mask) {
  return tracer_of(views).closest(ray, mask);
}
inline bool occluded(const TracedViews& views, const kernels::Ray& ray, u32 mask) {
  return tracer_of(views).occluded(ray, mask);
}
inline kernels::Hit closest_in(const TracedViews& views, u32 instance, const kernels::Ray& ray) {
  return tracer_of(views).closest_in(instance, ray);
}
inline bool meets(const TracedViews& views, u32 instance, const kernels::Ray& ray_object) {
  return tracer_of(views).meets(instance, ray_object);
}

inline u32 meets_of(const TracedViews& views, u32 instance, const host::RayPacket& rays,
                    u32 lanes) {
  if (lanes == 0) return 0;
  const kernels::BvhInstance& item = views.bvh->items[views.bvh->item_of_instance[instance]];
  const bool curves = views.scene->meshes[item.mesh].shape == kernels::Shape::kCurves;
  if (curves || (item.flags & kernels::kBvhShape) || !PacketWalk::go_together(rays, lanes)) {
    u32 met = 0;
    for (; lanes; lanes &= lanes - 1) {
      const u32 i = u32(std::countr_zero(lanes));
      met |= u32(meets(views, instance, rays.ray(i))) << i;
    }
    return met;
  }
  const PacketWalk walk(rays, lanes);
  if (item.triangles)
    return walk.meets(item.nodes,
                      [&](u32 i) -> const kernels::BvhTriangle& { return item.triangles[i]; });
  return walk.meets(item.nodes, [&](u32 i) {
    return kernels::deformed_triangle(*views.scene, *views.bvh, item.mesh, {i, rays.time});
  });
}

}  // namespace heliograph::bvh::inline HELIO_ISA
