// Surfaces that emit: their radiance, and how directions to them are chosen. Called by light.h.
#pragma once

#include "kernels/light/light_profile.h"
#include "kernels/light/light_shape.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A direction towards light, from a given point. What comes from there is light_radiance().
struct LightSample {
  vec3 direction;  // unit, world
  vec3 target;     // just before the light; meaningless for what is infinitely far
  float pdf;       // 1/sr, the choice of the light included
  u32 light;       // index into SceneView::lights; kNone: the dome or a sun
  u32 sun;         // where there is no light: index into SceneView::suns; kNone: the dome
  u32 primitive;   // of a triangle of a mesh
  float time;      // of the ray
  vec2 place;  // barycentric, meaningless for a shape that is_even(); in the dome's picture, row 0
               // at v = 0
  u32 visibility;  // ray mask bits of the emitting instance
};

/// True if a light shows to every kind of ray that scattering makes. If not, only sample_light()
/// and mirrors count it.
template <class Bits>
KERNEL auto shows_to_all(Bits visibility) {
  const Bits scattered(kDiffuseRay | kGlossyRay | kTransmissionRay);
  return (visibility & scattered) == scattered;
}

/// Radiance that a point of a surface emits in a direction, and that sample_light() counts where
/// the surface belongs to a light. wo: unit, world, leaves the surface.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL vec3 emitted(const SceneView& scene, const Surface& s,
                                                    const MaterialValues& m, vec3 wo) {
  const bool front = dot(wo, s.ng) >= 0;
  vec3 radiance(0);
  const MaterialView& material = *s.material;
  if (!material.unlit && (front || material.two_sided_emission)) {
    radiance = m.emission * m.emission_strength;
  }
  if (s.light == kNone) return radiance;
  const LightView& light = scene.lights[s.light];
  if (!front && !light.light_two_sided) return radiance;
  vec3 added = light.radiance;
  if (light.texture.texture != kNone) {
    added *= glm::max(vec3(sample_use<true>(scene, light.texture, uvs_at(s))), vec3(0));
  }
  if (light.profile != kNone) added *= profile_share(scene, light.profile, s, wo);
  return radiance + added * cone_share(light, s.pose.world_from_object, wo);
}

/// Radiance that a surface shows besides: the colour of unlit materials, light to whoever meets it
/// but unknown to sample_light().
KERNEL vec3 shown(const Surface& s, const MaterialValues& m) {
  return s.material->unlit ? m.base_color : vec3(0);
}

/// Density [1/sr] with which sample_light() would have taken the direction in which a ray from the
/// receiver met a light.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL float light_pdf(const SceneView& scene, Receiver from,
                                                       const Hit& hit, vec3 direction, u32 index) {
  const LightPlace at = light_place(scene, index, from.time);
  const TriangleTree& tree = at.light.tree;
  const float chosen = leaf_probability(scene.light_nodes, at.light.leaf, from, false);
  if (at.mesh.shape != Shape::kTriangles) {
    return from.surface_share * chosen * shape_pdf(at, from.p, direction, hit.t);
  }
  const u32 entry = tree.entry_of_triangle[hit.primitive];
  float within = 1;
  if (tree.nodes[tree.root].count == 0) {
    within = leaf_probability(tree.nodes, tree.entries[entry].leaf, to_object(at.pose, from),
                              emits_back(at.light));
  }
  const float pdf =
      from.surface_share * chosen * within * leaf_pdf(at, entry, from.p, direction, hit.t);
  return pdf > 0 ? pdf : 0;
}

/// True if a light has the same radiance at all its points in all directions.
KERNEL bool is_even(const LightView& light, const InstanceView& instance) {
  return !light.material_emits && light.texture.texture == kNone && light.cone_scale == 0 &&
         light.profile == kNone && !(instance.flags & kMayBeHole);
}
KERNEL bool is_even(const SceneView& scene, const LightView& light) {
  return is_even(light, scene.instances[light.instance]);
}

/// Sets LightView::sphere_radius, and the centre with it, where a light is such a sphere.
KERNEL void detect_sphere(LightView& light, const InstanceView& instance, Shape shape) {
  constexpr float kRounding = 1e-5f;
  const bool even = is_even(light, instance) && !light.light_two_sided &&
                    shows_to_all(instance.visibility) && instance.segments == 0;
  if (!even || shape != Shape::kSphere) return;
  const mat4x3& pose = instance.world_from_object;
  const float square = dot(pose[0], pose[0]);
  for (int i = 0; i < 3; ++i) {
    const float length2 = dot(pose[i], pose[i]), slant = dot(pose[i], pose[(i + 1) % 3]);
    if (!(std::fabs(length2 - square) <= kRounding * square) ||
        !(std::fabs(slant) <= kRounding * square)) {
      return;
    }
  }
  light.sphere_center = pose[3];
  light.sphere_radius = std::sqrt(square);
}

/// A point of a light that is even, as another point sees it.
template <class F>
struct LightPointOf {
  Vec3<F> direction;  // unit
  Vec3<F> target;     // LightSample::target
  F pdf;              // 1/sr, the choice of the light included
};
/// One of a sphere, which is chosen with `probability`.
template <class F>
KERNEL LightPointOf<F> sample_sphere_light(Vec3<F> center, F radius, Vec3<F> from, F probability,
                                           Vec2<F> u) {
  const SphereDirection<F> seen = sample_sphere_seen(center - from, radius, u);
  const Vec3<F> p = center + seen.normal * radius;
  return {normalize(p - from), p + seen.normal * sphere_error(center, radius, seen.normal),
          probability * seen.pdf};
}

/// The rest of a sample of a shape: its light is chosen, with `probability`.
KERNEL bool sample_shape_light(const SceneView& scene, const LightPlace& at, const Receiver& from,
                               float probability, vec2 u, LightSample& out) {
  const LightView& light = at.light;
  if (light.sphere_radius > 0) {
    const vec3 d = light.sphere_center - from.p;
    if (!(dot(d, d) > sqr(light.sphere_radius))) return false;
    const auto s =
        sample_sphere_light(light.sphere_center, light.sphere_radius, from.p, probability, u);
    out.direction = s.direction;
    out.target = s.target;
    out.pdf = s.pdf;
    out.primitive = 0;
    return true;
  }
  ShapePoint point;
  if (!sample_shape(at, from.p, u, point)) return false;
  const mat4x3& world = at.pose.world_from_object;
  const vec3 p = transform_point(world, point.p);
  out.direction = normalize(p - from.p);
  if (at.light.cone_scale != 0 && cone_share(at.light, world, -out.direction) == 0) return false;
  out.pdf = probability * point.pdf;
  if (!(out.pdf > 0)) return false;
  const Shape shape = at.mesh.shape;
  const vec3 normal = with_shape(shape, [&](auto of) { return decltype(of)::normal(point.p); });
  const vec3 n = normalize(transform_normal(at.pose.object_from_world, normal));
  const bool front = dot(out.direction, n) < 0;
  const float offset = plane_error(world, {vec3(0), vec3(1), vec3(1)}, n);
  out.target = p + n * (front ? offset : -offset);
  out.primitive = 0;
  if (!is_even(scene, at.light)) {
    out.place = with_shape(shape, [&](auto of) { return decltype(of)::place(point.p); });
  }
  return true;
}

/// choice: a leaf of the scene's tree. u: uniform in [0, 1)
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL bool sample_surface_light(const SceneView& scene,
                                                                 const Receiver& from,
                                                                 LeafChoice choice, float u,
                                                                 LightSample& out) {
  out.light = scene.light_nodes[choice.node].first;
  const LightPlace at = light_place(scene, out.light, from.time);
  out.time = from.time;
  out.visibility = at.instance.visibility;
  if (at.mesh.shape != Shape::kTriangles) {
    return sample_shape_light(scene, at, from, choice.probability, vec2(choice.rest, u), out);
  }
  const TriangleTree& tree = at.light.tree;
  choice.node = tree.root;
  if (tree.nodes[tree.root].count == 0) {
    choose_leaf(tree.nodes, to_object(at.pose, from), emits_back(at.light), choice);
  }
  TrianglePoint point;
  point.entry = choice.node;
  if (!sample_leaf(at, from.p, vec2(choice.rest, u), point)) return false;
  const vec3 normal = point.triangle.normal;
  const bool front = dot(point.direction, normal) < 0;
  if (!front && !emits_back(at.light)) return false;
  out.direction = point.direction;
  out.pdf = choice.probability * point.pdf;
  if (!(out.pdf > 0)) return false;
  const vec3 n = normalize(normal);
  const float offset = plane_error(at.pose.world_from_object, point.triangle.corners, n);
  out.target = point.p + n * (front ? offset : -offset);
  out.primitive = tree.entries[point.entry].triangle;
  out.place = point.place;
  return true;
}

/// Radiance of a sampled point of a surface.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL vec3 surface_radiance(const SceneView& scene,
                                                             const LightSample& sample) {
  const LightView& light = scene.lights[sample.light];
  if (is_even(scene, light)) return light.radiance;
  const Surface s = locate(scene, light.instance, sample.primitive, sample.place, sample.time);
  const vec3 radiance = emitted(scene, s, material_at(scene, s, kEmissionBits), -sample.direction);
  if (!(scene.instances[light.instance].flags & kMayBeHole)) return radiance;
  return radiance * opacity_at(scene, light.instance, sample.primitive, sample.place);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
