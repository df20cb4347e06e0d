// Proves that the kernels compile with nvcc: the entry points with a tracer that meets nothing.
// Built by the target kernels_compile_check; never run.
#include "kernels/accept.h"
#include "kernels/path.h"
#include "kernels/probe.h"

using namespace heliograph::kernels;

namespace {

struct EmptyTracer {
  const SceneView* scene;
  KERNEL Hit closest(const Ray& ray, u32 mask) const {
    const Hit hit{ray.t_max, mask % scene->instance_count, 0, 0.25f, 0.25f};
    return accepts(*scene, ray, hit) ? hit : Hit{INFINITY, kNone, 0, 0, 0};
  }
  KERNEL bool occluded(const Ray& ray, u32 mask) const { return closest(ray, mask).t < ray.t_max; }
  KERNEL Hit closest_in(u32 instance, const Ray& ray) const { return closest(ray, instance); }
};

}  // namespace

__global__ void render(SceneView scene, CameraView camera, Settings settings, FilmView film) {
  const EmptyTracer tracer{&scene};
  render_pixel(scene, camera, settings, tracer, film, threadIdx.x, blockIdx.x, 0, 16);
}

__global__ void probe(ProbeContext context, FilmView film) {
  const EmptyTracer tracer{context.now.scene};
  probe_pixel(context, tracer, &tracer, &tracer, film, threadIdx.x, blockIdx.x);
}
