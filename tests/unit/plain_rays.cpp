#define HELIO_PLAIN_RAYS
#define HELIO_ISA plain_rays
#include "tests/unit/plain_rays.h"

#include "kernels/bvh/bvh_tracer.h"

namespace heliograph::test {

kernels::Hit closest_plain(const kernels::SceneView& scene, const kernels::BvhView& bvh,
                           const kernels::Ray& ray, kernels::u32 mask) {
  return kernels::BvhTracer(scene, bvh).closest(ray, mask);
}

}  // namespace heliograph::test
