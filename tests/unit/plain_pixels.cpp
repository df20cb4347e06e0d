#define HELIO_PLAIN
#define HELIO_ISA plain
#if !defined(__clang__)  // g++ 12 warns of a BsdfSample that nobody reads unless it was set
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include "tests/unit/plain_pixels.h"

#include <vector>

#include "kernels/schedule/scalar.h"
#include "kernels/schedule/wave.h"

namespace heliograph::test {

using namespace kernels;

namespace {

struct PlainTracer {
  const RayAnswers& rays;
  Hit closest(const Ray& ray, u32 mask) const { return rays.closest(ray, mask); }
  bool occluded(const Ray& ray, u32 mask) const { return rays.occluded(ray, mask); }
  Hit closest_in(u32, const Ray& ray) const { return rays.closest(ray, 0); }  // of bodies alone
};

}  // namespace

u64 render_plain(const SceneView& scene, const CameraView& camera, const Settings& settings,
                 const RayAnswers& rays, const FilmView& film, u32 samples) {
  const PlainTracer tracer{rays};
  u64 traced = 0;
  for (u32 y = 0; y < film.height; ++y)
    for (u32 x = 0; x < film.width; ++x)
      traced += render_pixel(scene, camera, settings, tracer, film, x, y, 0, samples);
  return traced;
}

u64 render_plain_wave(const SceneView& scene, const CameraView& camera, const Settings& settings,
                      const RayAnswers& rays, const FilmView& film, u32 samples) {
  const PlainTracer tracer{rays};
  const ShotView shot{scene, camera, settings, film};
  const WaveWork work{0, tiles_of(film), 0, samples};
  std::vector<PathState> paths(items_of(work));
  std::vector<PathRay> rays_of(items_of(work));
  std::vector<WaveHit> hits(items_of(work));
  std::vector<WaveLight> lights(items_of(work));
  std::vector<WaveSample> of_samples(items_of(work));
  std::vector<WaveFirst> firsts(items_of(work));
  const WaveView view{.paths = paths.data(),
                      .rays = rays_of.data(),
                      .hits = hits.data(),
                      .lights = lights.data(),
                      .samples = of_samples.data(),
                      .firsts = firsts.data(),
                      .film = film};
  const Wave wave(shot, work, view, tracer);
  for (u32 item = 0; item < items_of(work); ++item) {
    Arrival arrival{wave.begin(item), false};
    while (arrival.goes_on || arrival.wants_shadow_ray) {
      const PathRay& ray = rays_of[item];
      if (arrival.goes_on) hits[item].hit = rays.closest(ray.ray, ray.mask);
      if (arrival.wants_shadow_ray && !rays.occluded(lights[item].ray, kShadowRay))
        wave.shine(item);
      arrival = arrival.goes_on ? wave.arrive(item) : Arrival{false, false};
    }
  }
  u64 traced = 0;
  for (u32 i = 0; i < pixels_of(work); ++i) traced += wave.fold(i);
  return traced;
}

}  // namespace heliograph::test
