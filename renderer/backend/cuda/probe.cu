// Centre planes: `probe` of the first vertex, `probe_later` of a later one.
#include "kernels/label/probe_path.h"
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

template <bool kLater>
__device__ u32 probe_item(const ProbeLaunch& l, const ItemPlace& at) {
  using LabelTracer = CalledTracer<Answers::kLabels>;
  const auto tracer_of = [](const ProbeEnd& end) { return LabelTracer{{end.scene, end.bvh}}; };
  const auto scene_of = [](const ProbeEnd& end) {
    return end.wanted ? ProbeScene{&end.scene, &end.camera, end.camera_jumped} : ProbeScene{};
  };
  const LabelTracer now = tracer_of(l.now), forward = tracer_of(l.forward),
                    backward = tracer_of(l.backward);
  const ProbeContext context{scene_of(l.now),      scene_of(l.forward),
                             scene_of(l.backward), l.wants_disparity ? &l.disparity : nullptr,
                             &l.settings,          l.rest_boxes};
  if constexpr (kLater) return probe_vertex(context, now, &forward, &backward, l.film, at.x, at.y);
  return probe_pixel(context, now, &forward, &backward, l.film, at.x, at.y);
}

template <bool kLater>
__device__ void probe_all(const ProbeLaunch* pictures, const WaveWork& work, u64* rays) {
  u32 traced = 0;
  for (u32 i = thread(); i < pixels_of(work); i += threads()) {
    const ItemPlace at = place_of(pictures->film, work, i);
    if (!at.in_image) continue;
    traced += probe_item<kLater>(pictures[picture_of(pictures->film, work, i)], at);
  }
  add_up(traced, *rays);
}

}  // namespace

// The centre planes of the pixels of some tiles. pictures: of one size
extern "C" __global__ void __launch_bounds__(kThreads)
    probe(const ProbeLaunch* pictures, WaveWork work, u64* rays) {
  probe_all<false>(pictures, work, rays);
}
extern "C" __global__ void __launch_bounds__(kThreads)
    probe_later(const ProbeLaunch* pictures, WaveWork work, u64* rays) {
  probe_all<true>(pictures, work, rays);
}
