// Rays, hits and what a backend must answer about them.
#pragma once

#include <concepts>

#include "kernels/scene/scene_view.h"

namespace heliograph::kernels {

/// Kinds of rays, as bits of InstanceView::visibility.
enum RayMask : u32 {
  kCameraRay = 1,
  kDiffuseRay = 2,
  kGlossyRay = 4,
  kTransmissionRay = 8,
  kShadowRay = 16,
  kVolumeRay = 32,
  kAllRays = 63,
  // Bits that a backend adds to those of the scene:
  kCatcherRay = 64,   // meets the shadow catchers that shadow rays meet
  kThroughRay = 128,  // meets what camera rays do, and shadow catchers
};

/// Inputs with which accepts() decides on a hole. A probe ray takes a surface with opacity >= 0.5;
/// any other one takes it when uniform(key, instance, primitive) < opacity, whatever the order of
/// traversal.
struct HoleKey {
  u32 key;
  bool probe;
};

struct Ray {
  vec3 origin;     // metres, world
  vec3 direction;  // unit unless stated otherwise
  float t_max;
  float time;  // within the scene's motion, [0, 1]
  HoleKey holes;
};

/// Metres from the world's origin, along each axis, within which rays begin. Single precision has
/// steps of 8 m there, and can still place that in the frame of an object of 1e-10 m.
inline constexpr float kReach = 1e8f;
/// The same in the frame of any object. Embree ends the process where a number of a ray, in
/// whatever frame, is larger than 1.84e18 or none.
inline constexpr float kFarthest = 1.8e18f;

/// True if a ray's numbers can be computed with; also false for what is no number. Tracers report
/// that others meet nothing.
///
/// longest   of the direction, along each axis
KERNEL bool is_sound(const Ray& ray, float reach = kReach, float longest = 2) {
  const auto is_within = [](vec3 v, float most) {
    return std::fabs(v.x) <= most && std::fabs(v.y) <= most && std::fabs(v.z) <= most;
  };
  return is_within(ray.origin, reach) && is_within(ray.direction, longest) &&
         ray.t_max == ray.t_max;
}

/// instance == kNone: nothing was hit, t = +inf. u, v: weights of vertices 1 and 2.
struct Hit {
  float t;
  u32 instance;
  u32 primitive;
  float u, v;
};

/// Rays of a camera through the pixels of a patch, and what they meet.
struct CameraRays {
  static constexpr u32 kMost = 8;
  const Ray* ray[kMost];
  Hit* hit[kMost];
  u32 count = 0;
  KERNEL void add(const Ray& next, Hit& met) {
    ray[count] = &next;
    hit[count++] = &met;
  }
};

/// A backend is who answers rays.
///
/// closest           nearest surface the mask meets and accepts() takes
/// occluded          whether there is any before t_max
/// closest_in        nearest surface of one instance alone, whatever hides it (silhouettes)
template <class T>
concept Tracer = requires(const T& tracer, const Ray& ray, u32 mask, u32 instance) {
  { tracer.closest(ray, mask) } -> std::same_as<Hit>;
  { tracer.occluded(ray, mask) } -> std::same_as<bool>;
  { tracer.closest_in(instance, ray) } -> std::same_as<Hit>;
};

/// Traces camera rays, together if the backend can.
template <Tracer T>
KERNEL void closest(const T& tracer, const CameraRays& rays) {
  if constexpr (requires { tracer.closest(rays); }) {
    tracer.closest(rays);
  } else {
    for (u32 i = 0; i < rays.count; ++i) *rays.hit[i] = tracer.closest(*rays.ray[i], kCameraRay);
  }
}

}  // namespace heliograph::kernels
