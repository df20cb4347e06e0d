// Light whose ray is traced later than its vertex is met: how paths side by side sample lights.
// Called by wave.h and lockstep.h.
#pragma once

#include "kernels/integrator/path.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Light that comes along its ray if nothing is in the way. t_max 0: there is none.
struct LaterLight {
  Ray ray;
  Contribution light;
  Route route;
};

/// Answers of a tracer, but for whether light is occluded: that is asked later.
template <Tracer T>
struct LaterTracer {
  const T& tracer;
  Ray& asked;         // t_max 0: nothing was
  LaterLight& light;  // that comes along this ray
  KERNEL Hit closest(const Ray& ray, u32 mask) const { return tracer.closest(ray, mask); }
  KERNEL bool occluded(const Ray& ray, u32) const {
    asked = ray;
    return false;
  }
  KERNEL Hit closest_in(u32 instance, const Ray& ray) const {
    return tracer.closest_in(instance, ray);
  }
};

template <Tracer T, class Other>
KERNEL PathContext<T> with_tracer(const PathContext<Other>& c, const T& tracer) {
  return {c.scene, c.camera, c.settings, tracer, c.film, c.sampler, c.time, c.pixel};
}

/// Keeps light until its ray is traced; what has no ray left counts at once.
template <Tracer T>
KERNEL void collect(const PathContext<LaterTracer<T>>& c, SampleValues& sample, Contribution light,
                    const Route& route) {
  const LaterTracer<T>& later = c.tracer;
  if (later.asked.t_max > 0)
    later.light = {later.asked, light, route};
  else
    collect(with_tracer(c, later.tracer), sample, light, route);
}

/// Calls f with a context in which light whose ray is asked for is left in `light`.
template <Tracer T, class F>
KERNEL void leave_for_later(const PathContext<T>& c, LaterLight& light, const F& f) {
  Ray asked;
  asked.t_max = 0;
  const LaterTracer<T> later{c.tracer, asked, light};
  f(with_tracer(c, later));
}

/// sample_light() at a vertex; what its ray decides is left in `light`.
template <Tracer T>
KERNEL void sample_light_later(const PathContext<T>& c, const Path& path, const Vertex& v,
                               SampleValues& sample, LaterLight& light) {
  leave_for_later(c, light, [&](const auto& later) { sample_light(later, path, v, sample); });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
