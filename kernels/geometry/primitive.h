// The kinds of primitives that rays meet: a type for each, which owns its bounds, where a ray of
// object space meets it, and its surface. Called by surface.h, exact.h and tracers.
//
// A kind has
//   bound(mesh, primitive, key, box)  extends a box by where the primitive is at a key of the mesh
//   meet(at, ray, hit)                where a ray meets it first; triangles leave that to tracers,
//                                     whose tests are watertight (bvh_meet.h, Embree)
//   surface(at, place)                a point of it
//   meet_exactly(at, ray, hit)        meet() in double precision, for labels; shapes have none
// How lights of a kind are sampled is in kernels/light: light_triangle.h, light_shape.h.
#pragma once

#include "kernels/geometry/curve.h"
#include "kernels/material/material.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Corners of a triangle in object space: one of them and the edges from it.
template <class V>
struct CornersOf {
  V a, ab, ac;
};
using Corners = CornersOf<vec3>;
template <class V = vec3>
KERNEL CornersOf<V> corners_of(const vec3* positions, uvec3 triangle) {
  const V a(positions[triangle.x]);
  return {a, V(positions[triangle.y]) - a, V(positions[triangle.z]) - a};
}

/// The same at a time, of a mesh that may deform.
template <class V = vec3>
KERNEL CornersOf<V> corners_at(const MeshView& mesh, uvec3 triangle, float time) {
  if (mesh.segments == 0) return corners_of<V>(mesh.positions, triangle);
  const Segment s = segment_at(mesh.segments, time);
  const vec3* positions = mesh.positions + u64(s.index) * mesh.vertex_count;
  const CornersOf<V> from = corners_of<V>(positions, triangle);
  const CornersOf<V> to = corners_of<V>(positions + mesh.vertex_count, triangle);
  const typename V::value_type u(s.u);
  const auto mix = [u](V a, V b) { return a * (1 - u) + b * u; };
  return {mix(from.a, to.a), mix(from.ab, to.ab), mix(from.ac, to.ac)};
}

/// A point of a surface in object space, its normal of any length, and corners that are as large as
/// the numbers that it was computed from.
template <class F>
struct PrimitiveSurfaceOf {
  Vec3<F> p, normal;
  CornersOf<Vec3<F>> extent;
};
using PrimitiveSurface = PrimitiveSurfaceOf<float>;

/// A ray of the world in double precision, and where the object is.
struct ExactRay {
  glm::dmat4x3 world_from_object;
  glm::dvec3 origin, direction;  // unit
};
/// A hit's distance and its place: the weights of vertices 1 and 2, or as curve.h has it.
struct ExactHit {
  double t, u, v;
};

struct Triangles {
  template <class Box>
  KERNEL static void bound(const MeshView& mesh, u32 primitive, u32 key, Box& box) {
    const vec3* positions = mesh.positions + u64(key) * mesh.vertex_count;
    for (int k = 0; k < 3; ++k) box.extend(positions[mesh.triangles[primitive][k]]);
  }
  template <class F>
  KERNEL static PrimitiveSurfaceOf<F> surface(const CornersOf<Vec3<F>>& c, Vec2<F> weights) {
    return {c.a + c.ab * weights.x + c.ac * weights.y, cross(c.ab, c.ac), c};
  }
  KERNEL static PrimitiveSurface surface(const PrimitiveAt& at, vec2 weights) {
    return surface(corners_at(at.mesh, at.mesh.triangles[at.primitive], at.time), weights);
  }
  KERNEL static bool meet_exactly(const PrimitiveAt& at, const ExactRay& ray, ExactHit& hit) {
    using glm::dvec3;
    const auto c = corners_at<dvec3>(at.mesh, at.mesh.triangles[at.primitive], at.time);
    const glm::dmat4x3& pose = ray.world_from_object;
    const glm::dmat3 linear{pose[0], pose[1], pose[2]};
    const dvec3 ab = linear * c.ab, ac = linear * c.ac;
    const dvec3 to_a = linear * c.a + (pose[3] - ray.origin);
    const dvec3 normal = cross(ab, ac), r = cross(to_a, ray.direction);
    const double inverse = 1 / dot(normal, ray.direction);
    hit = {dot(normal, to_a) * inverse, dot(r, ac) * inverse, -dot(r, ab) * inverse};
    constexpr double kBeside = -0.125;
    return hit.t > 0 && hit.u > kBeside && hit.v > kBeside && 1 - hit.u - hit.v > kBeside;
  }
};

/// A mesh that stands for a shape (shape.h).
template <class S>
struct Whole {
  template <class Box>
  KERNEL static void bound(const MeshView&, u32, u32, Box& box) {
    box.extend(-S::reach());
    box.extend(S::reach());
  }
  KERNEL static bool meet(const PrimitiveAt&, const ShapeRay& ray, ShapeHit& hit) {
    return S::meet(ray, hit);
  }
  KERNEL static PrimitiveSurface surface(const PrimitiveAt&, vec2 place) {
    const vec3 p = S::point(place);
    return {p, S::normal(p), {vec3(0), vec3(1), vec3(1)}};
  }
};

struct Curves {
  template <class Box>
  KERNEL static void bound(const MeshView& mesh, u32 primitive, u32 key, Box& box) {
    const uvec3 points = mesh.triangles[primitive];
    for (int k = 0; k < 2; ++k) {
      const vec3 p = mesh.positions[u64(key) * mesh.vertex_count + points[k]];
      const float radius = mesh.strand_points[points[k]].w;
      // Rounding moves what rays meet, and points between two keys, by less.
      const vec3 reach = vec3(radius * (1 + 0x1p-18f)) + abs3(p) * 0x1p-21f;
      box.extend(p - reach);
      box.extend(p + reach);
    }
  }
  KERNEL static bool meet(const PrimitiveAt& at, const ShapeRay& ray, ShapeHit& hit) {
    SegmentHitOf<float> met;
    if (!meet_segment<float>(at, {ray.origin, ray.direction, ray.t_max}, met)) return false;
    hit = {met.t, met.place};
    return true;
  }
  HELIO_GPU_NOINLINE KERNEL static PrimitiveSurface surface(const PrimitiveAt& at, vec2 place) {
    const uvec3 points = at.mesh.triangles[at.primitive];
    const RoundSegment s = round_segment(at.mesh, points, at.time);
    const ConeOf<float> cone = cone_of(scaled(s, scale_of(s)));
    const SegmentPoint point = segment_point(s, cone, zero_of(at.mesh, points, cone.axis), place);
    const vec3 width(max2(s.ra, s.rb));
    return {s.a + point.p, point.normal, {s.a, abs3(s.ab) + width, width}};
  }
  HELIO_GPU_NOINLINE KERNEL static bool meet_exactly(const PrimitiveAt& at, const ExactRay& ray,
                                                     ExactHit& hit) {
    const glm::dmat4x3& pose = ray.world_from_object;
    const glm::dmat3 to_object = glm::inverse(glm::dmat3{pose[0], pose[1], pose[2]});
    SegmentHitOf<double> met;
    if (!meet_segment<double>(
            at, {to_object * (ray.origin - pose[3]), to_object * ray.direction, INFINITY}, met)) {
      return false;
    }
    hit = {met.t, met.place.x, met.place.y};
    return true;
  }
};

/// Calls f with the kind of a mesh.
template <class F>
KERNEL auto with_kind(Shape shape, const F& f) {
  switch (shape) {
    case Shape::kTriangles:
      return f(Triangles{});
    case Shape::kCurves:
      return f(Curves{});
    default:
      return with_shape(shape, [&](auto of) { return f(Whole<decltype(of)>{}); });
  }
}

KERNEL PrimitiveSurface primitive_surface(const PrimitiveAt& at, vec2 place) {
  if (has_curves(at.mesh)) return Curves::surface(at, place);
  if (is_round(at.mesh.shape)) {
    return with_shape(at.mesh.shape,
                      [&](auto of) { return Whole<decltype(of)>::surface(at, place); });
  }
  return Triangles::surface(at, place);  // a flat shape's plane is that of its triangle
}

/// Extends a box by where a primitive is at a key of its mesh.
template <class Box>
KERNEL void bound_primitive(const MeshView& mesh, u32 primitive, u32 key, Box& box) {
  with_kind(mesh.shape, [&](auto kind) { decltype(kind)::bound(mesh, primitive, key, box); });
}

/// Where a ray of object space first meets a primitive that is no triangle, at t in (0, t_max].
HELIO_GPU_NOINLINE KERNEL bool meet_primitive(const PrimitiveAt& at, const ShapeRay& ray,
                                              ShapeHit& hit) {
  return with_kind(at.mesh.shape, [&](auto kind) {
    if constexpr (requires { decltype(kind)::meet(at, ray, hit); })
      return decltype(kind)::meet(at, ray, hit);
    return false;
  });
}

/// Edges along which texture coordinates grow at a point of a segment: along the strand, and once
/// around it.
///
/// place   u in [0, 1]
HELIO_GPU_NOINLINE KERNEL Corners strand_edges(const MeshView& mesh, uvec3 points, float time,
                                               vec2 place) {
  const RoundSegment s = round_segment(mesh, points, time);
  const ConeOf<float> cone = cone_of(scaled(s, scale_of(s)));
  const SegmentPoint point = segment_point(s, cone, zero_of(mesh, points, cone.axis), place);
  return {s.a, s.ab, point.around * (2 * kPi * (s.ra + (s.rb - s.ra) * place.x))};
}

}  // namespace heliograph::kernels::inline HELIO_ISA
