// One path after the other: the plainest way to run the path tracer, which the others are held
// against.
#pragma once

#include "kernels/integrator/path.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Traces one path and all the light it meets.
template <Tracer T>
KERNEL SampleValues trace_path(const PathContext<T>& c, u32 x, u32 y) {
  SampleValues sample;
  LaterLight light;
  Path path = begin_sample(c, first_ray(c, x, y), sample);
  bool goes_on = true;
  while (goes_on && path.ray.t_max > 0) {
    const Reach reach = set_out(c, path);
    const Hit hit = c.tracer.closest(path.ray, path.mask);
    light.ray.t_max = 0;
    goes_on = advance(c, path, reach, hit, sample, &light);
    shine(c, light, sample);
  }
  return sample;
}

/// Adds samples [first_sample, first_sample + sample_count) of pixel (x, y) to the film; returns
/// rays traced.
template <Tracer T>
KERNEL u32 render_pixel(const SceneView& scene, const CameraView& camera, const Settings& settings,
                        const T& tracer, const FilmView& film, u32 x, u32 y, u32 first_sample,
                        u32 sample_count) {
  const u64 key = pixel_key(settings.seed, x, y);
  const u64 pixel = u64(y) * film.width + x;
  u32 rays = 0;
  for (u32 i = first_sample; i < first_sample + sample_count; ++i) {
    const Sampler sampler(key, i);
    const float time = path_time(camera, sampler, x, y);
    const CameraAt now(camera, time);
    const PathContext<T> context{scene, now.camera(), settings, tracer, film, sampler, time, pixel};
    const SampleValues sample = trace_path(context, x, y);
    write_sample(film, pixel, sample, (i + 1) % kBlock == 0);
    rays += sample.rays;
  }
  return rays;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
