// The kernels' loops over pixels, compiled once for each x86-64 level and chosen at run time.
#pragma once

#include "kernels/label/probe.h"
#include "renderer/backend/embree/tracer.h"
#include "renderer/host/tasks.h"

namespace heliograph::embree {

using host::PixelRect;

/// host::RenderTask, and host::ProbeTask below, for an EmbreeTracer.
struct RenderTask {
  TracedScene scene;
  SecondLook look;
  const kernels::CameraView* camera;
  const kernels::Settings* settings;
  const kernels::FilmView* film;
};

struct ProbeTask {
  kernels::ProbeContext context;
  TracedScene now, forward, backward;  // the latter two empty where the context has none
  const kernels::FilmView* film;
};

/// Both return the rays traced. Thread: any, on rectangles that do not overlap.
struct PixelLoops {
  const char* isa;
  kernels::u64 (*render)(const RenderTask&, const PixelRect&, kernels::u32 first_sample,
                         kernels::u32 samples);
  kernels::u64 (*probe)(const ProbeTask&, const PixelRect&);
};
extern const PixelLoops kPixelLoopsV2;
extern const PixelLoops kPixelLoopsV3;

/// The best level this processor has.
[[nodiscard]] const PixelLoops& best_pixel_loops();

}  // namespace heliograph::embree
