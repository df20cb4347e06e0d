#include "renderer/backend/embree/room.h"

#include "kernels/camera/rolling.h"
#include "kernels/core/warp.h"
#include "renderer/backend/embree/tracer.h"

namespace heliograph::embree {

SecondLook second_look(const TracedScene& scene, const kernels::CameraView& camera) {
  constexpr u32 kDirections = 128;
  const kernels::CameraAt now(camera, camera.shutter.open);
  kernels::Ray ray{};
  ray.origin = now.camera().world_from_camera[3];
  ray.t_max = INFINITY;
  ray.time = now.camera().time;
  ray.holes.probe = true;
  const EmbreeTracer tracer(scene);
  Box room;
  for (u32 i = 0; i < kDirections; ++i) {
    // A spiral with the golden ratio, its points in such an order that a sky is met early.
    const float k = float(i * 45 % kDirections) + 0.5f;
    ray.direction = kernels::sample_sphere({k / kDirections, k * 0.6180339887f});
    const kernels::Hit hit = tracer.closest(ray, kernels::kCameraRay);
    if (hit.instance == kernels::kNone) return {};
    room.extend(ray.origin + ray.direction * hit.t);
  }
  // Rounding must not put a wall outside.
  const vec3 margin = 1e-4f * (room.upper - room.lower);
  return {SecondLook::Of::kRaysOut, room.lower - margin, room.upper + margin};
}

}  // namespace heliograph::embree
