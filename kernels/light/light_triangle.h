// Directions to the triangles of one leaf of a mesh part's light tree. Called by light.h.
#pragma once

#include "kernels/core/warp.h"
#include "kernels/geometry/surface.h"
#include "kernels/light/light_tree.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A light at one time.
struct LightPlace {
  const LightView& light;
  const InstanceView& instance;
  const MeshView& mesh;
  ObjectPose pose;
  float time;
};
KERNEL LightPlace light_place(const SceneView& scene, u32 index, float time) {
  const LightView& light = scene.lights[index];
  const InstanceView& instance = scene.instances[light.instance];
  return {light, instance, scene.meshes[instance.mesh], pose_at(scene, instance, time), time};
}

/// A triangle in world space.
template <class F>
struct WorldTriangleOf {
  Vec3<F> a, ab, ac;
  Vec3<F> normal;  // of the front side, its length twice the area
};
/// One of a light.
struct LightTriangle : WorldTriangleOf<float> {
  Corners corners;  // in object space
};
KERNEL LightTriangle light_triangle(const LightPlace& at, u32 entry) {
  const uvec3 vertices = at.mesh.triangles[at.light.tree.entries[entry].triangle];
  const mat4x3& world = at.pose.world_from_object;
  LightTriangle t;
  t.corners = corners_at(at.mesh, vertices, at.time);
  t.a = transform_point(world, t.corners.a);
  t.ab = transform_vector(world, t.corners.ab);
  t.ac = transform_vector(world, t.corners.ac);
  t.normal = cross(t.ab, t.ac);
  if (at.instance.flags & kFlipped) t.normal = -t.normal;
  return t;
}

/// True if light leaves the back sides of a light, too.
KERNEL bool emits_back(const LightView& light) {
  return light.light_two_sided || (light.material_emits && light.material_two_sided);
}

/// Density [1/sr] of a direction to a point of a triangle, chosen by area. d: unit.
template <class F>
KERNEL F area_pdf(const WorldTriangleOf<F>& t, Vec3<F> d, F distance) {
  const F projected = 0.5f * abs(dot(t.normal, d));
  return select(projected > 0, sqr(distance) / projected, F(0));
}

// ---------------------------------------------------------------- solid angles

/// A triangle as the unit sphere about a point shows it.
///
/// Source: Peters 2021, "BRDF Importance Sampling for Polygonal Lights", section 3.2, after Arvo
/// 1995. g0 / (g1 + g2) is the tangent of half the solid angle (van Oosterom and Strackee 1983).
template <class F>
struct SphereTriangleOf {
  Vec3<F> v0, v1, v2;  // unit
  F g0, g1, g2;
  F solid_angle;
};
using SphereTriangle = SphereTriangleOf<float>;
template <class F>
KERNEL SphereTriangleOf<F> sphere_triangle(Vec3<F> a, Vec3<F> ab, Vec3<F> ac, Vec3<F> p) {
  const Vec3<F> d0 = a - p, d1 = d0 + ab, d2 = d0 + ac;
  const F i0 = 1 / sqrt(dot(d0, d0)), i1 = 1 / sqrt(dot(d1, d1)), i2 = 1 / sqrt(dot(d2, d2));
  SphereTriangleOf<F> s{d0 * i0, d1 * i1, d2 * i2, F(0), F(0), F(0), F(0)};
  s.g0 = abs(dot(d0, cross(ab, ac))) * (i0 * i1 * i2);
  s.g1 = dot(s.v0, s.v2) + dot(s.v1, s.v2);
  s.g2 = 1 + dot(s.v0, s.v1);
  s.solid_angle = 4 * kPi * atan2_turns(s.g0, s.g1 + s.g2);
  return s;
}

/// Uniform in the triangle's solid angle.
template <class F>
KERNEL Vec3<F> sample_sphere_triangle(const SphereTriangleOf<F>& s, Vec2<F> u) {
  const SinCosOf<F> half = sincos_turns(F(u.x * s.solid_angle * (0.25f * kInvPi)));
  const Vec3<F> r = s.v0 * (s.g0 * half.cos - s.g1 * half.sin) + s.v2 * (s.g2 * half.sin);
  const Vec3<F> v = normalize_or(r * (2 * dot(s.v0, r) / max2(dot(r, r), F(1e-30f))) - s.v0, s.v2);
  // Between v1 and v, uniform in the cosine to v1.
  const F far = dot(s.v1, v);
  const F drop = u.y * 0.5f * dot(s.v1 - v, s.v1 - v);  // u.y (1 - far), without cancellation
  const Vec3<F> side = normalize_or(v - s.v1 * far, Vec3<F>(F(0)));
  return s.v1 * (1 - drop) + side * safe_sqrt(drop * (2 - drop));
}

/// True if the triangles of a leaf are large enough, seen from a point, to be sampled by solid
/// angle.
///
/// center, radius2   of the leaf; p: in object space
template <class F>
KERNEL BoolOf<F> is_near(Vec3<F> center, F radius2, Vec3<F> p) {
  constexpr float kNear = 0.25f;
  const Vec3<F> d = center - p;
  return radius2 > kNear * dot(d, d);
}
KERNEL bool is_near(const LightNode& leaf, vec3 p_object) {
  return is_near(leaf.center, leaf.radius2, p_object);
}

/// A triangle that shows less of itself is not sampled by solid angle.
inline constexpr float kLeastSolidAngle = 1e-7f;

/// The solid angle of a triangle times its radiosity; 0 where it shows a side that is dark.
struct NearTriangle {
  SphereTriangle seen;
  float weight;
};
KERNEL NearTriangle near_triangle(const LightPlace& at, u32 entry, vec3 p) {
  const LightTriangle t = light_triangle(at, entry);
  if (dot(p - t.a, t.normal) <= 0 && !emits_back(at.light)) return {{}, 0};
  NearTriangle n{sphere_triangle(t.a, t.ab, t.ac, p), 0};
  const bool visible = n.seen.solid_angle > kLeastSolidAngle;
  if (visible) n.weight = at.light.tree.entries[entry].radiosity * n.seen.solid_angle;
  return n;
}

// ---------------------------------------------------------------- leaves

/// A point of a triangle, its direction from p, and its density among those of the leaf.
struct TrianglePoint {
  LightTriangle triangle;
  u32 entry;
  vec2 place;  // barycentric
  vec3 p;
  vec3 direction;
  float distance;
  float pdf;  // 1/sr
};

/// Place of the point in which a ray from p meets the plane of a triangle, moved into the triangle.
template <class F>
KERNEL Vec2<F> place_of(const WorldTriangleOf<F>& t, Vec3<F> p, Vec3<F> direction) {
  const Vec3<F> h = cross(direction, t.ac);
  const F det = dot(t.ab, h);
  const Vec3<F> d = p - t.a;
  const F x = clamp01(F(dot(d, h) / det));
  const F y = clamp01(F(dot(direction, cross(d, t.ab)) / det));
  return select(x + y > 1, Vec2<F>(x / (x + y), y / (x + y)), Vec2<F>(x, y));
}

KERNEL void set_target(TrianglePoint& out, vec3 p) {
  out.p = out.triangle.a + out.triangle.ab * out.place.x + out.triangle.ac * out.place.y;
  const vec3 d = out.p - p;
  out.distance = length(d);
  out.direction = d / out.distance;
}

KERNEL bool sample_near_leaf(const LightPlace& at, vec3 p, vec2 u, TrianglePoint& out) {
  const LightNode& leaf = at.light.tree.nodes[out.entry];
  NearTriangle triangles[kLeafTriangles];
  float total = 0;
  for (u32 i = 0; i < leaf.count; ++i) {
    triangles[i] = near_triangle(at, leaf.first + i, p);
    total += triangles[i].weight;
  }
  if (!(total > 0)) return false;
  float rest = u.x * total;
  u32 chosen = 0;
  for (u32 i = 0; i < leaf.count; ++i) {
    if (!(triangles[i].weight > 0)) continue;
    chosen = i;
    if (rest < triangles[i].weight) break;
    rest -= triangles[i].weight;
  }
  const SphereTriangle& seen = triangles[chosen].seen;
  u.x = rescale_uniform(rest, triangles[chosen].weight);
  out.entry = leaf.first + chosen;
  out.triangle = light_triangle(at, out.entry);
  out.place = place_of<float>(out.triangle, p, sample_sphere_triangle(seen, u));
  set_target(out, p);
  out.pdf = triangles[chosen].weight / (total * seen.solid_angle);
  return true;
}

/// Chooses a point of a leaf's triangles. io.entry: the leaf, then the chosen entry.
HELIO_GPU_NOINLINE KERNEL bool sample_leaf(const LightPlace& at, vec3 p, vec2 u,
                                           TrianglePoint& io) {
  const LightNode& leaf = at.light.tree.nodes[io.entry];
  if (is_near(leaf, transform_point(at.pose.object_from_world, p))) {
    return sample_near_leaf(at, p, u, io);
  }
  const TriangleEntry* entries = at.light.tree.entries;
  float rest = u.x * leaf.power;
  u32 entry = leaf.first;
  while (rest >= entries[entry].power && entry + 1 < leaf.first + leaf.count) {
    rest -= entries[entry++].power;
  }
  io.entry = entry;
  io.triangle = light_triangle(at, entry);
  io.place = sample_triangle(vec2(rescale_uniform(rest, entries[entry].power), u.y));
  set_target(io, p);
  io.pdf =
      area_pdf<float>(io.triangle, io.direction, io.distance) * entries[entry].power / leaf.power;
  return true;
}

/// Density [1/sr] with which sample_leaf() takes the direction to a point of an entry.
HELIO_GPU_NOINLINE KERNEL float leaf_pdf(const LightPlace& at, u32 entry, vec3 p, vec3 direction,
                                         float distance) {
  const TriangleEntry& e = at.light.tree.entries[entry];
  const LightNode& leaf = at.light.tree.nodes[e.leaf];
  if (!is_near(leaf, transform_point(at.pose.object_from_world, p))) {
    const LightTriangle t = light_triangle(at, entry);
    return area_pdf<float>(t, direction, distance) * e.power / leaf.power;
  }
  float total = 0;
  bool seen = false;
  for (u32 i = leaf.first; i < leaf.first + leaf.count; ++i) {
    const float weight = near_triangle(at, i, p).weight;
    total += weight;
    seen |= i == entry && weight > 0;
  }
  return seen ? e.radiosity / total : 0;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
