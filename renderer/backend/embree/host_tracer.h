// Embree's answers to single rays, for labels and questions. Called by embree_backend.cpp.
#pragma once

#include "renderer/backend/embree/tracer.h"
#include "renderer/host/tracer.h"

namespace heliograph::embree {

/// Lifetime: of the TracedScene's parts.
class EmbreeHostTracer final : public host::HostTracer {
 public:
  explicit EmbreeHostTracer(const TracedScene& scene)
      : scene_(scene), tracer_(scene, kAlwaysAgain) {}

  [[nodiscard]] kernels::Hit closest(const kernels::Ray& ray, u32 mask) const override {
    return tracer_.closest(ray, mask);
  }
  [[nodiscard]] bool occluded(const kernels::Ray& ray, u32 mask) const override {
    return tracer_.occluded(ray, mask);
  }
  [[nodiscard]] kernels::Hit closest_in(u32 instance, const kernels::Ray& ray) const override {
    return tracer_.closest_in(instance, ray);
  }
  [[nodiscard]] bool meets(u32 instance, const kernels::Ray& ray_object) const override {
    return tracer_.meets(instance, ray_object);
  }
  [[nodiscard]] u32 meets_of(u32 instance, const host::RayPacket& rays_object,
                             u32 lanes) const override;

 private:
  TracedScene scene_;
  EmbreeTracer tracer_;
};

}  // namespace heliograph::embree
