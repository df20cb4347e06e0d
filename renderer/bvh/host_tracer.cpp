#include "renderer/bvh/host_tracer.h"

#include "renderer/bvh/accelerator.h"

namespace heliograph::bvh {

BvhHostTracer::BvhHostTracer(const resident::ResidentScene& scene)
    : BvhHostTracer(scene, best_rays()) {}

BvhHostTracer::BvhHostTracer(const resident::ResidentScene& scene, const RayFunctions& functions)
    : functions_(functions), scene_(scene) {}

kernels::Hit BvhHostTracer::closest(const kernels::Ray& ray, u32 mask) const {
  const kernels::BvhView bvh = world_view(scene_.placement());
  return functions_.closest({&scene_.view(), &bvh}, ray, mask);
}
bool BvhHostTracer::occluded(const kernels::Ray& ray, u32 mask) const {
  const kernels::BvhView bvh = world_view(scene_.placement());
  return functions_.occluded({&scene_.view(), &bvh}, ray, mask);
}
kernels::Hit BvhHostTracer::closest_in(u32 instance, const kernels::Ray& ray) const {
  const kernels::BvhView bvh = objects_view(scene_.placement());
  return functions_.closest_in({&scene_.view(), &bvh}, instance, ray);
}
bool BvhHostTracer::meets(u32 instance, const kernels::Ray& ray_object) const {
  const kernels::BvhView bvh = objects_view(scene_.placement());
  return functions_.meets({&scene_.view(), &bvh}, instance, ray_object);
}
u32 BvhHostTracer::meets_of(u32 instance, const host::RayPacket& rays, u32 lanes) const {
  const kernels::BvhView bvh = objects_view(scene_.placement());
  return functions_.meets_of({&scene_.view(), &bvh}, instance, rays, lanes);
}

}  // namespace heliograph::bvh
