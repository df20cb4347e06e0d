// Labels of a later vertex: what the path through a pixel's centre meets after it has scattered.
// probe_vertex() is the entry point of every backend.
#pragma once

#include "kernels/integrator/path.h"
#include "kernels/label/probe.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// The ray that leaves the vertex before Settings::vertex, of the path that sets out through the
/// pixel's centre and goes on as the pixel's first sample would; none where the path has ended.
template <Tracer T>
KERNEL Sight sight_along_path(const ProbeContext& context, const T& tracer, const Ray& first,
                              uvec2 pixel, u32& rays) {
  Settings settings = *context.settings;
  settings.max_depth = settings.vertex + 1;
  settings.roulette_depth = kNone;
  const Sampler sampler(pixel_key(settings.seed, pixel.x, pixel.y), 0);
  FilmView nothing{};
  const PathContext<T> c{
      *context.now.scene, *context.now.camera, settings, tracer, nothing, sampler, first.time, 0};
  SampleValues sample;
  Path path = path_along(c, first, sample);
  bool goes_on = first.t_max > 0;
  while (goes_on && path.edges <= settings.vertex) {
    const Reach reach = set_out(c, path);
    const Hit hit = tracer.closest(path.ray, path.mask);
    goes_on = advance(c, path, reach, hit, sample, nullptr);
  }
  rays += sample.rays;
  if (!goes_on) path.ray.t_max = 0;
  return {path.ray, path.mask, path.passed, glm::dvec3(path.ray.direction)};
}

/// probe_pixel() for a Settings::vertex above 0.
template <Tracer T>
KERNEL u32 probe_vertex(const ProbeContext& context, const T& tracer, const T* forward_tracer,
                        const T* backward_tracer, const FilmView& film, u32 x, u32 y) {
  const T* const tracers[3] = {&tracer, forward_tracer, backward_tracer};
  return probe_by(context, tracers, film, {x, y}, [&](const ProbeContext& at_row, u32& rays) {
    const Ray first = centre_ray(*at_row.now.camera, centre_of(x, y));
    return sight_along_path(at_row, tracer, first, {x, y}, rays);
  });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
