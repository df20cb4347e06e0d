// The walk of programs for plain rays, see kRichRays in kernels/core/platform.h.
#pragma once

#include "kernels/bvh/bvh.h"
#include "kernels/scene/ray.h"

namespace heliograph::test {

kernels::Hit closest_plain(const kernels::SceneView& scene, const kernels::BvhView& bvh,
                           const kernels::Ray& ray, kernels::u32 mask);

}  // namespace heliograph::test
