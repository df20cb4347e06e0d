// Rays for x86-64-v3.
#define HELIO_ISA v3
#include "renderer/bvh/rays_body.h"

namespace heliograph::bvh {
const RayFunctions kRaysV3{closest, occluded, closest_in, meets, meets_of};
}
