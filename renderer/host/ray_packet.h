// Rays that are traced together. Seen by tracers that are compiled for several instruction sets.
#pragma once

#include "kernels/scene/ray.h"

namespace heliograph::host {

/// Rays of one time that start and go nearly alike.
struct alignas(32) RayPacket {
  static constexpr kernels::u32 kRays = 8;
  float origin_x[kRays], origin_y[kRays], origin_z[kRays];
  float direction_x[kRays], direction_y[kRays], direction_z[kRays];
  float t_min[kRays], t_max[kRays];
  float time;

  /// It begins at t_min, and takes whatever opacity of one half and more does.
  [[nodiscard]] kernels::Ray ray(kernels::u32 i) const {
    const kernels::vec3 origin(origin_x[i], origin_y[i], origin_z[i]);
    const kernels::vec3 direction(direction_x[i], direction_y[i], direction_z[i]);
    return {t_min[i] > 0 ? origin + direction * t_min[i] : origin,
            direction,
            t_max[i] - t_min[i],
            time,
            {.key = 0, .probe = true}};
  }
};

}  // namespace heliograph::host
