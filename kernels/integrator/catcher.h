// Shadow catchers: stand-ins for what a picture shows that a render is laid over. Called by path.h.
#pragma once

#include "kernels/light/light.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A scene, who answers its rays, and how many they were.
template <Tracer T>
struct CatcherScene {
  const SceneView& scene;
  const T& tracer;
  u32& rays;
};

/// Random numbers in [0, 1).
struct CatcherNumbers {
  HoleKey holes;
  vec2 light;  // one of them and a direction to it
  vec2 open;   // of the hemisphere
};

/// Light that comes along a ray to a catcher: with other entities in its way, and without.
template <Tracer T>
KERNEL vec2 caught_along(const CatcherScene<T>& c, const Ray& ray, float irradiance) {
  if (!(irradiance > 0)) return vec2(0);
  c.rays += 2;
  if (c.tracer.occluded(ray, kCatcherRay)) return vec2(0);
  return vec2(c.tracer.occluded(ray, kShadowRay) ? 0 : irradiance, irradiance);
}

/// Luminance of the direct irradiance of the catcher that a camera ray would see first, on the side
/// it sees: with other entities in the way of light, and without; 0 if it is none. The dome is
/// found by its texels and by cosine.
template <Tracer T>
KERNEL vec2 see_catcher(const CatcherScene<T>& c, const Ray& seen, const CatcherNumbers& u) {
  const SceneView& scene = c.scene;
  if (!(seen.t_max > 0)) return vec2(0);
  const Hit hit = c.tracer.closest(seen, kThroughRay);
  ++c.rays;
  if (hit.instance == kNone || !(scene.instances[hit.instance].flags & kCatcher)) return vec2(0);
  const Surface s = surface_at(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), seen.time);
  const vec3 n = dot(seen.direction, s.ng) < 0 ? s.ns : -s.ns;
  vec2 caught(0);
  LightSample light;
  const Receiver receiver = receiver_at(scene, s.p, n, Facing::kFront, seen.time);
  if (sample_light(scene, receiver, u.light, light) && (light.visibility & kDiffuseRay)) {
    const ShadowRayOf<float> to = shadow_ray(offset_point(s, light.direction), direction_of(light));
    if (!to.is_there) return caught;
    const Ray ray{to.origin, to.direction, to.end, seen.time, u.holes};
    const float cosine = max2(dot(n, light.direction), 0.0f);
    const bool dome = light.light == kNone && light.sun == kNone;
    const float weight = dome ? mis_weight(light.pdf, cosine * kInvPi) : 1;
    const float radiance = luminance(light_radiance(scene, light));
    caught += caught_along(c, ray, radiance * cosine * weight / light.pdf);
  }
  if (!(scene.dome.probability > 0)) return caught;
  const vec3 local = sample_cosine(u.open);
  const vec3 d = to_world(make_frame(n), local);
  const DomePlace place = dome_place(scene.dome, d);
  const float pdf = sky_share(receiver) * dome_pdf(scene.dome, receiver, d, place);
  const float weight = mis_weight(local.z * kInvPi, pdf);
  const Ray open{offset_point(s, d), d, INFINITY, seen.time, u.holes};
  return caught + caught_along(c, open, luminance(dome_radiance(scene, place.uv)) * kPi * weight);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
