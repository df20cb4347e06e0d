// The walk of programs for plain rays, see kRichRays in kernels/platform.h.
#pragma once

#include "kernels/bvh.h"
#include "kernels/ray.h"

namespace heliograph::test {

kernels::Hit closest_plain(const kernels::SceneView& scene, const kernels::BvhView& bvh,
                           const kernels::Ray& ray, kernels::u32 mask);

}  // namespace heliograph::test
