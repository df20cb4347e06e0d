// Single rays of the host through the kernels' BVH, for labels and questions. Used by backends
// whose device walks the same trees.
#pragma once

#include "renderer/bvh/rays.h"
#include "renderer/host/tracer.h"

namespace heliograph::bvh {

/// Its first rays make what they go through, see BvhScene. Lifetime: of the scene, which was
/// prepared with a BvhAccelerator.
class BvhHostTracer final : public host::HostTracer {
 public:
  explicit BvhHostTracer(const resident::ResidentScene& scene);
  /// With the functions of a level that this processor has.
  BvhHostTracer(const resident::ResidentScene& scene, const RayFunctions& functions);
  [[nodiscard]] kernels::Hit closest(const kernels::Ray& ray, u32 mask) const override;
  [[nodiscard]] bool occluded(const kernels::Ray& ray, u32 mask) const override;
  [[nodiscard]] kernels::Hit closest_in(u32 instance, const kernels::Ray& ray) const override;
  [[nodiscard]] bool meets(u32 instance, const kernels::Ray& ray_object) const override;
  [[nodiscard]] u32 meets_of(u32 instance, const host::RayPacket& rays_object,
                             u32 lanes) const override;

 private:
  const RayFunctions& functions_;
  const resident::ResidentScene& scene_;
};

}  // namespace heliograph::bvh
