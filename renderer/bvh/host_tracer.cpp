#include "renderer/bvh/host_tracer.h"

#include "renderer/bvh/accelerator.h"

namespace heliograph::bvh {

BvhHostTracer::BvhHostTracer(const resident::ResidentScene& scene)
    : bvh_(view(scene.placement())), tracer_(scene.view(), bvh_) {}

kernels::Hit BvhHostTracer::closest(const kernels::Ray& ray, u32 mask) const {
  return tracer_.closest(ray, mask);
}
bool BvhHostTracer::occluded(const kernels::Ray& ray, u32 mask) const {
  return tracer_.occluded(ray, mask);
}
kernels::Hit BvhHostTracer::closest_in(u32 instance, const kernels::Ray& ray) const {
  return tracer_.closest_in(instance, ray);
}
bool BvhHostTracer::meets(u32 instance, const kernels::Ray& ray_object) const {
  return tracer_.meets(instance, ray_object);
}

}  // namespace heliograph::bvh
