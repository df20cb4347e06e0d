// The loops themselves. Included by the translation unit of each level, which defines HELIO_ISA.
#pragma once

#include "kernels/label/probe_path.h"
#include "kernels/schedule/lockstep.h"
#include "renderer/backend/embree/pixel_loop.h"

namespace heliograph::embree::inline HELIO_ISA {

inline kernels::u64 render_rect(const RenderTask& task, const PixelRect& rect,
                                kernels::u32 first_sample, kernels::u32 samples) {
  return kernels::render_rect(*task.scene.view, *task.camera, *task.settings,
                              EmbreeTracer(task.scene), *task.film, rect, first_sample, samples);
}

inline kernels::u64 probe_rect(const ProbeTask& task, const PixelRect& rect) {
  const EmbreeTracer now(task.now), forward(task.forward), backward(task.backward);
  const auto probe = task.context.settings->vertex > 0 ? kernels::probe_vertex<EmbreeTracer>
                                                       : kernels::probe_pixel<EmbreeTracer>;
  kernels::u64 rays = 0;
  for (kernels::u32 y = rect.y0; y < rect.y1; ++y)
    for (kernels::u32 x = rect.x0; x < rect.x1; ++x)
      rays += probe(task.context, now, task.forward.view ? &forward : nullptr,
                    task.backward.view ? &backward : nullptr, *task.film, x, y);
  return rays;
}

}  // namespace heliograph::embree::inline HELIO_ISA
