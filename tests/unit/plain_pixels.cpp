#define HELIO_PLAIN
#define HELIO_ISA plain
#if !defined(__clang__)  // g++ 12 warns of a BsdfSample that nobody reads unless it was set
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include "tests/unit/plain_pixels.h"

#include "kernels/path.h"

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

}  // namespace heliograph::test
