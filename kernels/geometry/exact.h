// Where a ray meets a primitive, worked out again in double precision, and which of two surfaces a
// label takes where single precision cannot decide. Called by probe_sight.h and by tracers.
#pragma once

#include "kernels/geometry/motion.h"
#include "kernels/geometry/surface.h"
#include "kernels/scene/ray.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// By meet_triangle() in single precision a place on a floor of two triangles, a kilometre wide,
/// may be off by a millimetre. False where the kind has no such test, and where the ray passes
/// beside the primitive.
///
/// direction   of the ray, unit
KERNEL bool meet_exactly(const SceneView& scene, const Ray& ray, glm::dvec3 direction,
                         const Hit& hit, ExactHit& exact) {
  const InstanceView& instance = scene.instances[hit.instance];
  const PrimitiveAt at{scene.meshes[instance.mesh], hit.primitive, ray.time};
  return with_kind(at.mesh.shape, [&](auto kind) {
    if constexpr (!requires { &decltype(kind)::meet_exactly; })
      return false;
    else
      return decltype(kind)::meet_exactly(
          at,
          {glm::dmat4x3(pose_at(scene, instance, ray.time).world_from_object),
           glm::dvec3(ray.origin), direction},
          exact);
  });
}

/// Relative distances within which single precision may not tell which of two surfaces is nearer.
inline constexpr float kUnclear = 0x1p-18f;

/// True if a label takes surface `a` rather than `b`, which are within kUnclear: the nearer one in
/// double precision; where their vertices put them at one place, that of the smaller label, 0
/// coming last.
HELIO_RARE KERNEL bool comes_before(const SceneView& scene, const Ray& ray, const Hit& a,
                                    const Hit& b) {
  if (a.instance == b.instance) return a.t < b.t || (a.t == b.t && a.primitive < b.primitive);
  constexpr double kAtOnePlace = 0x1p-22;
  const glm::dvec3 direction(ray.direction);
  ExactHit of_a{a.t, 0, 0}, of_b{b.t, 0, 0};
  if (ExactHit exact; meet_exactly(scene, ray, direction, a, exact)) of_a = exact;
  if (ExactHit exact; meet_exactly(scene, ray, direction, b, exact)) of_b = exact;
  if (std::fabs(of_a.t - of_b.t) > kAtOnePlace * of_a.t) return of_a.t < of_b.t;
  const u32 label_a = scene.instances[a.instance].label - 1;
  const u32 label_b = scene.instances[b.instance].label - 1;
  return label_a != label_b ? label_a < label_b : a.instance < b.instance;
}

/// True if a label takes `hit` in place of the best one so far, which may be none.
KERNEL bool takes_over(const SceneView& scene, const Ray& ray, const Hit& hit, const Hit& best) {
  return best.instance == kNone || hit.t < best.t * (1 - kUnclear) ||
         comes_before(scene, ray, hit, best);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
