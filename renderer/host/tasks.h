// Rays to trace for a film, described without a tracer. Made by film.h, traced by backends.
#pragma once

#include "kernels/label/probe.h"

namespace heliograph::resident {
class ResidentScene;
}

namespace heliograph::host {

using namespace resident;

using kernels::PixelRect;

/// Samples of one scene. The views lie in the host's memory, and so do their arrays.
struct RenderTask {
  const ResidentScene* scene;
  const kernels::CameraView* camera;
  const kernels::Settings* settings;
  const kernels::FilmView* film;
};

/// Centre planes. The view of `now` is ResidentScene::view_without_instances(). A flow end's view
/// in the context has instances and volumes of its own, marked kFlowInvalid; all else is as in its
/// scene.
struct ProbeTask {
  kernels::ProbeContext context;
  std::size_t rest_boxes;                         // of the context
  const ResidentScene *now, *forward, *backward;  // the latter two null where the context has none
  const kernels::FilmView* film;
};

}  // namespace heliograph::host
