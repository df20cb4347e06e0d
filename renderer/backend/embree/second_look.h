// Rays that slip between two triangles. Embree's fast test computes an edge by each of the
// triangles at it: one ray of about a million is outside of both. Its robust test, which has no
// such gaps, takes a tenth to a sixth longer for every ray; here the few that may have slipped are
// asked again.
#pragma once

#include "kernels/scene/ray.h"
#include "renderer/backend/embree/traced_scene.h"

namespace heliograph::embree {

/// Answers of Embree's that are looked at again.
struct SecondLook {
  enum class Of {
    kNone,
    kRaysOut,  // of rays that end outside of a box
    kAll,
  };
  Of of = Of::kNone;
  vec3 lower{0}, upper{0};  // the box

  [[nodiscard]] bool is_due(const kernels::Ray& ray, float t) const {
    if (of != Of::kRaysOut) return of == Of::kAll;
    const vec3 end = ray.origin + ray.direction * t;
    return !(glm::all(glm::lessThanEqual(lower, end)) && glm::all(glm::lessThanEqual(end, upper)));
  }
};
inline constexpr SecondLook kAlwaysAgain{.of = SecondLook::Of::kAll};

/// Returns what a ray meets where Embree answered `first`: triangles that 8 rays a hair beside it,
/// 2^-21 to 2^-14 rad, meet are met by the ray itself as kernels::meet_triangle() does, which is
/// watertight. The nearest of these and `first` is the answer.
[[nodiscard]] kernels::Hit look_again(const TracedScene& scene, const kernels::Ray& ray,
                                      kernels::u32 mask, const kernels::Hit& first);
/// The same of one instance alone, by a ray of its object space that met nothing there.
[[nodiscard]] bool meets_after_all(const TracedScene& scene, kernels::u32 instance,
                                   const kernels::Ray& ray_object);

}  // namespace heliograph::embree
