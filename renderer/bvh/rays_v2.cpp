// Rays for x86-64-v2.
#define HELIO_ISA v2
#include "renderer/bvh/rays_body.h"

namespace heliograph::bvh {
const RayFunctions kRaysV2{closest, occluded, closest_in, meets, meets_of};
}
