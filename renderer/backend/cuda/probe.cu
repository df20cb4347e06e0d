// Centre planes.
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

__device__ u32 probe_item(const ProbeLaunch& l, const ItemPlace& at) {
  const auto tracer_of = [](const ProbeEnd& end) { return CalledTracer{{end.scene, end.bvh}}; };
  const auto scene_of = [](const ProbeEnd& end) {
    return end.wanted ? ProbeScene{&end.scene, &end.camera, end.camera_jumped} : ProbeScene{};
  };
  const CalledTracer now = tracer_of(l.now), forward = tracer_of(l.forward),
                     backward = tracer_of(l.backward);
  const ProbeContext context{scene_of(l.now), scene_of(l.forward), scene_of(l.backward),
                             l.wants_disparity ? &l.disparity : nullptr, &l.settings};
  return probe_pixel(context, now, &forward, &backward, l.film, at.x, at.y);
}

}  // namespace

// The centre planes of the pixels of some tiles. pictures: of one size
extern "C" __global__ void __launch_bounds__(kThreads)
    probe(const ProbeLaunch* pictures, WaveWork work, u64* rays) {
  u32 traced = 0;
  for (u32 i = thread(); i < pixels_of(work); i += threads()) {
    const ItemPlace at = place_of(pictures->film, work, i);
    if (!at.in_image) continue;
    traced += probe_item(pictures[picture_of(pictures->film, work, i)], at);
  }
  add_up(traced, *rays);
}
