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

/// A triangle of a light in world space.
struct LightTriangle {
  vec3 a, ab, ac;
  vec3 normal;      // of the front side, its length twice the area
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

/// Whether light leaves the back sides of a light, too.
KERNEL bool emits_back(const LightView& light) {
  return light.light_two_sided || (light.material_emits && light.material_two_sided);
}

/// Density [1/sr] of a direction to a point of a triangle, chosen by area. d: unit.
KERNEL float area_pdf(const LightTriangle& t, vec3 d, float distance) {
  const float projected = 0.5f * std::fabs(dot(t.normal, d));
  return projected > 0 ? sqr(distance) / projected : 0;
}

// ---------------------------------------------------------------- solid angles

/// A triangle as the unit sphere about a point shows it.
///
/// Source: Peters 2021, "BRDF Importance Sampling for Polygonal Lights", section 3.2, after Arvo
/// 1995. g0 / (g1 + g2) is the tangent of half the solid angle (van Oosterom and Strackee 1983).
struct SphereTriangle {
  vec3 v0, v1, v2;  // unit
  float g0, g1, g2;
  float solid_angle;
};
KERNEL SphereTriangle sphere_triangle(vec3 a, vec3 ab, vec3 ac, vec3 p) {
  const vec3 d0 = a - p, d1 = d0 + ab, d2 = d0 + ac;
  const float i0 = 1 / length(d0), i1 = 1 / length(d1), i2 = 1 / length(d2);
  SphereTriangle s{d0 * i0, d1 * i1, d2 * i2, 0, 0, 0, 0};
  s.g0 = std::fabs(dot(d0, cross(ab, ac))) * (i0 * i1 * i2);
  s.g1 = dot(s.v0, s.v2) + dot(s.v1, s.v2);
  s.g2 = 1 + dot(s.v0, s.v1);
  s.solid_angle = 4 * kPi * atan2_turns(s.g0, s.g1 + s.g2);
  return s;
}

/// Uniform in the triangle's solid angle.
KERNEL vec3 sample_sphere_triangle(const SphereTriangle& s, vec2 u) {
  const SinCos half = sincos_turns(u.x * s.solid_angle * (0.25f * kInvPi));
  const vec3 r = s.v0 * (s.g0 * half.cos - s.g1 * half.sin) + s.v2 * (s.g2 * half.sin);
  const vec3 v = normalize_or(r * (2 * dot(s.v0, r) / max2(dot(r, r), 1e-30f)) - s.v0, s.v2);
  // Between v1 and v, uniform in the cosine to v1.
  const float far = dot(s.v1, v);
  const float drop = u.y * 0.5f * dot(s.v1 - v, s.v1 - v);  // u.y (1 - far), without cancellation
  const vec3 side = normalize_or(v - s.v1 * far, vec3(0));
  return s.v1 * (1 - drop) + side * safe_sqrt(drop * (2 - drop));
}

/// Whether the triangles of a leaf are large enough, seen from a point, to be sampled by solid
/// angle.
KERNEL bool is_near(const LightNode& leaf, vec3 p_object) {
  constexpr float kNear = 0.25f;
  const vec3 d = leaf.center - p_object;
  return leaf.radius2 > kNear * dot(d, d);
}

/// The solid angle of a triangle times its radiosity; 0 where it shows a side that is dark.
struct NearTriangle {
  SphereTriangle seen;
  float weight;
};
KERNEL NearTriangle near_triangle(const LightPlace& at, u32 entry, vec3 p) {
  const LightTriangle t = light_triangle(at, entry);
  if (dot(p - t.a, t.normal) <= 0 && !emits_back(at.light)) return {{}, 0};
  NearTriangle n{sphere_triangle(t.a, t.ab, t.ac, p), 0};
  const bool visible = n.seen.solid_angle > 1e-7f;
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
KERNEL vec2 place_of(const LightTriangle& t, vec3 p, vec3 direction) {
  const vec3 h = cross(direction, t.ac);
  const float det = dot(t.ab, h);
  const vec3 d = p - t.a;
  const float x = clamp01(dot(d, h) / det);
  const float y = clamp01(dot(direction, cross(d, t.ab)) / det);
  return x + y > 1 ? vec2(x, y) / (x + y) : vec2(x, y);
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
  out.place = place_of(out.triangle, p, sample_sphere_triangle(seen, u));
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
  io.pdf = area_pdf(io.triangle, io.direction, io.distance) * entries[entry].power / leaf.power;
  return true;
}

/// Density [1/sr] with which sample_leaf() takes the direction to a point of an entry.
HELIO_GPU_NOINLINE KERNEL float leaf_pdf(const LightPlace& at, u32 entry, vec3 p, vec3 direction,
                                         float distance) {
  const TriangleEntry& e = at.light.tree.entries[entry];
  const LightNode& leaf = at.light.tree.nodes[e.leaf];
  if (!is_near(leaf, transform_point(at.pose.object_from_world, p))) {
    const LightTriangle t = light_triangle(at, entry);
    return area_pdf(t, direction, distance) * e.power / leaf.power;
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
