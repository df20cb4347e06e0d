// Rays, hits and what a backend must answer about them.
#pragma once

#include <concepts>

#include "kernels/scene_view.h"

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
  // Of what a backend adds to the bits of the scene:
  kCatcherRay = 64,   // meets the shadow catchers that shadow rays meet
  kThroughRay = 128,  // meets what camera rays do, and shadow catchers
};

/// What accepts() needs to decide on a hole. A probe ray takes a surface with opacity >= 0.5; any
/// other one takes it when uniform(key, instance, primitive) < opacity, whatever the order of
/// traversal.
struct HoleKey {
  u32 key;
  bool probe;
};

struct Ray {
  vec3 origin;     // metres, world
  vec3 direction;  // unit unless said otherwise
  float t_max;
  float time;  // within the scene's motion, [0, 1]
  HoleKey holes;
};

/// instance == kNone: nothing was hit, t = +inf. u, v: weights of vertices 1 and 2.
struct Hit {
  float t;
  u32 instance;
  u32 primitive;
  float u, v;
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

}  // namespace heliograph::kernels
