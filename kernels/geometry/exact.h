// Where a ray meets a primitive, worked out again in double precision, and which of two surfaces a
// label takes where single precision cannot tell. Called by probe_sight.h and by tracers.
#pragma once

#include "kernels/geometry/motion.h"
#include "kernels/geometry/surface.h"
#include "kernels/scene/ray.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A hit's distance and its place: the weights of vertices 1 and 2, or as curve.h has it.
struct ExactHit {
  double t, u, v;
};

/// The same ray in the space of an object, in double precision.
HELIO_GPU_NOINLINE KERNEL bool meet_strand_exactly(const SceneView& scene, const Ray& ray,
                                                   glm::dvec3 direction, const Hit& hit,
                                                   ExactHit& exact) {
  const InstanceView& instance = scene.instances[hit.instance];
  const glm::dmat4x3 pose(pose_at(scene, instance, ray.time).world_from_object);
  const glm::dmat3 to_object = glm::inverse(glm::dmat3{pose[0], pose[1], pose[2]});
  const SegmentRayOf<double> local{to_object * (glm::dvec3(ray.origin) - pose[3]),
                                   to_object * direction, INFINITY};
  SegmentHitOf<double> met;
  const PrimitiveAt at{scene.meshes[instance.mesh], hit.primitive, ray.time};
  if (!meet_segment<double>(at, local, met)) return false;
  exact = {met.t, met.place.x, met.place.y};
  return true;
}

/// By meet_triangle() in single precision a place on a floor of two triangles, a kilometre wide,
/// may be off by a millimetre. False for a disc and a sphere, and where the ray passes beside the
/// primitive.
///
/// direction   of the ray, unit
KERNEL bool meet_exactly(const SceneView& scene, const Ray& ray, glm::dvec3 direction,
                         const Hit& hit, ExactHit& exact) {
  using glm::dvec3;
  const InstanceView& instance = scene.instances[hit.instance];
  const MeshView& mesh = scene.meshes[instance.mesh];
  if (mesh.shape == Shape::kCurves) return meet_strand_exactly(scene, ray, direction, hit, exact);
  if (mesh.shape != Shape::kTriangles) return false;
  const auto c = corners_at<dvec3>(mesh, mesh.triangles[hit.primitive], ray.time);
  const glm::dmat4x3 pose(pose_at(scene, instance, ray.time).world_from_object);
  const glm::dmat3 linear{pose[0], pose[1], pose[2]};
  const dvec3 ab = linear * c.ab, ac = linear * c.ac;
  const dvec3 to_a = linear * c.a + (pose[3] - dvec3(ray.origin));
  const dvec3 normal = cross(ab, ac), r = cross(to_a, direction);
  const double inverse = 1 / dot(normal, direction);
  exact = {dot(normal, to_a) * inverse, dot(r, ac) * inverse, -dot(r, ab) * inverse};
  constexpr double kBeside = -0.125;
  return exact.t > 0 && exact.u > kBeside && exact.v > kBeside && 1 - exact.u - exact.v > kBeside;
}

/// Relative distances within which single precision may not tell which of two surfaces is nearer.
inline constexpr float kUnclear = 0x1p-18f;

/// Whether a label takes surface `a` rather than `b`, which are within kUnclear: the nearer one in
/// double precision; of two at one place, as far as their vertices tell, that of the smaller label,
/// 0 coming last.
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

/// Whether a label takes `hit` in place of the best one so far, which may be none.
KERNEL bool takes_over(const SceneView& scene, const Ray& ray, const Hit& hit, const Hit& best) {
  return best.instance == kNone || hit.t < best.t * (1 - kUnclear) ||
         comes_before(scene, ray, hit, best);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
