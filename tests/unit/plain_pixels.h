// The loop over pixels as plain programs have it, see kRich in kernels/core/platform.h.
#pragma once

#include <functional>

#include "kernels/scene/film.h"
#include "kernels/scene/ray.h"
#include "kernels/scene/scene_view.h"
#include "kernels/scene/settings.h"

namespace heliograph::test {

/// Who answers rays, as a Tracer does.
struct RayAnswers {
  std::function<kernels::Hit(const kernels::Ray&, kernels::u32)> closest;
  std::function<bool(const kernels::Ray&, kernels::u32)> occluded;
};

/// The first `samples` samples of all pixels. Returns the rays traced.
kernels::u64 render_plain(const kernels::SceneView& scene, const kernels::CameraView& camera,
                          const kernels::Settings& settings, const RayAnswers& rays,
                          const kernels::FilmView& film, kernels::u32 samples);

/// The same by a wave of one path at a time.
kernels::u64 render_plain_wave(const kernels::SceneView& scene, const kernels::CameraView& camera,
                               const kernels::Settings& settings, const RayAnswers& rays,
                               const kernels::FilmView& film, kernels::u32 samples);

}  // namespace heliograph::test
