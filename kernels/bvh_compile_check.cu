// Proves that the walk through the BVH compiles with nvcc, apart from the path tracer, which takes
// minutes. Built by the target kernels_compile_check; never run.
#include "kernels/bvh_tracer.h"

using namespace heliograph::kernels;

__global__ void trace(const __grid_constant__ SceneView scene, const __grid_constant__ BvhView bvh,
                      const Ray* rays, Hit* hits) {
  const u32 i = blockIdx.x * blockDim.x + threadIdx.x;
  BvhStack stack;
  BvhWalk walk(scene, bvh, stack);
  walk.begin(rays[i], kCameraRay, false);
  while (walk.step()) {
  }
  hits[i] = walk.hit();
}

__global__ void meet(const __grid_constant__ SceneView scene, const __grid_constant__ BvhView bvh,
                     const Ray* rays, bool* met) {
  const u32 i = blockIdx.x * blockDim.x + threadIdx.x;
  const BvhTracer tracer(scene, bvh);
  met[i] = tracer.occluded(rays[i], kShadowRay) || tracer.meets(0, rays[i]) ||
           tracer.closest_in(1, rays[i]).t < rays[i].t_max;
}
