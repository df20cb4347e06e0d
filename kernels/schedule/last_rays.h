// The last rays of paths: where they end no light is sampled, so that they count only where they
// meet what emits. Most cannot, and are not traced. Called by lockstep.h.
#pragma once

#include "kernels/core/lanes.h"
#include "kernels/integrator/path.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Targets of a ray.
enum class Seeks : u8 { kSurface, kSky, kNothing };

class LastRays {
 public:
  LastRays(const SceneView& scene, const Settings& settings)
      : edges_(settings.max_depth),
        only_lights_emit_(!scene.any_unlit && !scene.any_curves && !scene.any_media &&
                          scene.volume_count == 0),
        has_sky_(!is_black(scene.dome.radiance) || scene.sun_count > 0) {
    if (only_lights_emit_ && scene.light_count > 0) add_lights(scene.light_nodes);
  }

  /// Target of the ray of a path on its way from a surface.
  [[nodiscard]] Seeks of(const Path& path) const {
    if (path.edges != edges_ || path.edges == 1 || !path.guided || !only_lights_emit_ ||
        may_meet_lights(path.ray)) {
      return Seeks::kSurface;
    }
    return has_sky_ ? Seeks::kSky : Seeks::kNothing;
  }

 private:
  /// Spheres about all lights: of nodes of their tree, the largest ones parted.
  void add_lights(const LightNode* nodes) {
    u32 chosen[kLanes] = {0}, count = 1;
    while (count < kLanes) {
      u32 largest = kNone;
      for (u32 i = 0; i < count; ++i) {
        const LightNode& node = nodes[chosen[i]];
        if (node.count == 0 &&
            (largest == kNone || node.radius2 > nodes[chosen[largest]].radius2)) {
          largest = i;
        }
      }
      if (largest == kNone) break;
      const u32 first = nodes[chosen[largest]].first;
      chosen[largest] = first;
      chosen[count++] = first + 1;
    }
    for (u32 i = 0; i < kLanes; ++i) {
      const LightNode& node = nodes[chosen[min2(i, count - 1)]];
      put(center_, i, node.center);
      put(radius2_, i, node.radius2);
    }
    has_lights_ = true;
  }
  /// True where rounding leaves it open.
  [[nodiscard]] bool may_meet_lights(const Ray& ray) const {
    if (!has_lights_) return false;
    constexpr float kRounding = 1e-5f;
    const Vec3<Floats> d = center_ - Vec3<Floats>(ray.origin);
    const Floats along = dot(d, Vec3<Floats>(ray.direction)), distance2 = dot(d, d);
    const Floats reach2 = radius2_ * (1 + kRounding) + distance2 * kRounding;
    const Mask beside = distance2 - along * along > reach2;
    const Mask behind = (along < 0) & (distance2 > reach2);
    return !all(beside | behind);
  }

  const u32 edges_;  // of a path with its last ray
  const bool only_lights_emit_, has_sky_;
  bool has_lights_ = false;
  Vec3<Floats> center_{0};
  Floats radius2_ = 0;
};

}  // namespace heliograph::kernels::inline HELIO_ISA
