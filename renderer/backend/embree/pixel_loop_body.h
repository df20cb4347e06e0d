// The loops themselves. Included by the translation unit of each level, which defines HELIO_ISA.
#pragma once

#include <algorithm>

#include "kernels/label/probe_path.h"
#include "kernels/schedule/lockstep.h"
#include "renderer/backend/embree/pixel_loop.h"
#include "renderer/backend/embree/probe_tracer.h"

namespace heliograph::embree::inline HELIO_ISA {

inline kernels::u64 render_rect(const RenderTask& task, const PixelRect& rect,
                                kernels::u32 first_sample, kernels::u32 samples) {
  return kernels::render_rect(*task.scene.view, *task.camera, *task.settings,
                              EmbreeTracer(task.scene, task.look), *task.film, rect, first_sample,
                              samples);
}

/// Tracers that answer the probes of one task.
struct ProbeTracers {
  explicit ProbeTracers(const ProbeTask& task)
      : now(task.now), forward(task.forward), backward(task.backward) {
    if (task.forward.view) all[1] = &forward;
    if (task.backward.view) all[2] = &backward;
  }
  ProbeTracer now, forward, backward;
  const ProbeTracer* all[3] = {&now, nullptr, nullptr};
};

template <class F>
void for_each_pixel(const PixelRect& rect, const F& f) {
  for (kernels::u32 y = rect.y0; y < rect.y1; ++y)
    for (kernels::u32 x = rect.x0; x < rect.x1; ++x) f(x, y);
}

/// Probes through the centres of a patch's pixels.
inline kernels::u64 probe_patch(const ProbeTask& task, ProbeTracers& tracers,
                                const PixelRect& patch) {
  const kernels::CameraView& camera = *task.context.now.camera;
  kernels::Sight sights[kernels::kPatchPixels];
  kernels::u32 count = 0;
  for_each_pixel(patch, [&](kernels::u32 x, kernels::u32 y) {
    const kernels::vec2 centre = kernels::centre_of(x, y);
    const kernels::CameraAt now(camera, kernels::pixel_time(camera, x, y));
    sights[count++] = kernels::centre_sight(now.camera(), centre);
  });
  tracers.now.trace_ahead({sights, count});
  kernels::u64 rays = 0;
  const kernels::Sight* sight = sights;
  for_each_pixel(patch, [&](kernels::u32 x, kernels::u32 y) {
    rays +=
        kernels::probe_by(task.context, tracers.all, *task.film, {x, y},
                          [&](const kernels::ProbeContext&, kernels::u32&) { return *sight++; });
  });
  return rays;
}

inline kernels::u64 probe_rect(const ProbeTask& task, const PixelRect& rect) {
  ProbeTracers tracers(task);
  kernels::u64 rays = 0;
  if (task.context.settings->vertex > 0) {
    for_each_pixel(rect, [&](kernels::u32 x, kernels::u32 y) {
      rays += kernels::probe_vertex(task.context, tracers.now, tracers.all[1], tracers.all[2],
                                    *task.film, x, y);
    });
    return rays;
  }
  for (kernels::u32 y = rect.y0; y < rect.y1; y += kernels::kPatchHeight)
    for (kernels::u32 x = rect.x0; x < rect.x1; x += kernels::kPatchWidth)
      rays += probe_patch(task, tracers,
                          {x, y, std::min(x + kernels::kPatchWidth, rect.x1),
                           std::min(y + kernels::kPatchHeight, rect.y1)});
  return rays;
}

}  // namespace heliograph::embree::inline HELIO_ISA
