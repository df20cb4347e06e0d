#include "renderer/bvh/host_tracer.h"

#include "renderer/bvh/accelerator.h"

namespace heliograph::bvh {

BvhHostTracer::BvhHostTracer(const resident::ResidentScene& scene)
    : BvhHostTracer(scene, best_rays()) {}

BvhHostTracer::BvhHostTracer(const resident::ResidentScene& scene, const RayFunctions& functions)
    : functions_(functions), bvh_(view(scene.placement())), views_{&scene.view(), &bvh_} {}

kernels::Hit BvhHostTracer::closest(const kernels::Ray& ray, u32 mask) const {
  return functions_.closest(views_, ray, mask);
}
bool BvhHostTracer::occluded(const kernels::Ray& ray, u32 mask) const {
  return functions_.occluded(views_, ray, mask);
}
kernels::Hit BvhHostTracer::closest_in(u32 instance, const kernels::Ray& ray) const {
  return functions_.closest_in(views_, instance, ray);
}
bool BvhHostTracer::meets(u32 instance, const kernels::Ray& ray_object) const {
  return functions_.meets(views_, instance, ray_object);
}
u32 BvhHostTracer::meets_of(u32 instance, const host::RayPacket& rays, u32 lanes) const {
  return functions_.meets_of(views_, instance, rays, lanes);
}

}  // namespace heliograph::bvh
