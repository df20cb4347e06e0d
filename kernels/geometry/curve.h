// Round segments: what curves are made of, as hairs, cables and grass. Called by primitive.h.
//
// A segment is the convex hull of two spheres: a piece of a cone with a piece of a sphere at each
// end. The segments of a strand share their spheres, so no ray passes between them. A point of a
// segment is named by a place: u goes along it, in [0, 1] from the circle where the cone leaves the
// first sphere to that where it reaches the second one, in [-1, 0) over the first sphere from its
// pole, in (1, 2] over the second one to its pole; v in [0, 1) goes around it: from
// outside, it grows to the left of u. F is float, or double for labels.
#pragma once

#include "kernels/geometry/motion.h"
#include "kernels/geometry/shape.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Two spheres; the second one is at a + ab.
template <class F>
struct RoundSegmentOf {
  Vec3<F> a, ab;
  F ra, rb;
};
using RoundSegment = RoundSegmentOf<float>;

/// A primitive of a mesh, as it is at a time.
struct PrimitiveAt {
  const MeshView& mesh;
  u32 primitive;
  float time;
};

template <class F>
KERNEL Vec3<F> vertex_of(const MeshView& mesh, u32 vertex, float time) {
  if (mesh.segments == 0) return Vec3<F>(mesh.positions[vertex]);
  const Segment s = segment_at(mesh.segments, time);
  const vec3* from = mesh.positions + u64(s.index) * mesh.vertex_count + vertex;
  return Vec3<F>(from[0]) * (1 - F(s.u)) + Vec3<F>(from[mesh.vertex_count]) * F(s.u);
}

/// points   MeshView::triangles has of it
template <class F = float>
KERNEL RoundSegmentOf<F> round_segment(const MeshView& mesh, uvec3 points, float time) {
  const Vec3<F> a = vertex_of<F>(mesh, points.x, time);
  return {a, vertex_of<F>(mesh, points.y, time) - a, F(mesh.strand_points[points.x].w),
          F(mesh.strand_points[points.y].w)};
}

/// The cone that touches both spheres. Where one of them holds the other there is none: then it has
/// no width, and the larger sphere is the segment.
template <class F>
struct ConeOf {
  Vec3<F> axis;  // unit, from the first sphere to the second one
  F length;
  F sine, cosine;  // of the angle by which its normals lean along the axis; cosine 0: no cone
};
template <class F>
KERNEL ConeOf<F> cone_of(const RoundSegmentOf<F>& s) {
  const F length = std::sqrt(dot(s.ab, s.ab)), narrows = s.ra - s.rb;
  const Vec3<F> axis = length > 0 ? s.ab / length : Vec3<F>(0, 0, 1);
  if (!(std::fabs(narrows) < length)) return {axis, length, narrows < 0 ? F(-1) : F(1), F(0)};
  const F sine = narrows / length;
  return {axis, length, sine, std::sqrt((1 - sine) * (1 + sine))};
}

/// A power of two that brings the segment's size near 1, so that no square leaves a float's range.
template <class F>
KERNEL F scale_of(const RoundSegmentOf<F>& s) {
  return F(scale_near_one(float(max2(max_component(abs(s.ab)), max2(s.ra, s.rb)))));
}
template <class F>
KERNEL RoundSegmentOf<F> scaled(const RoundSegmentOf<F>& s, F scale) {
  return {s.a * scale, s.ab * scale, s.ra * scale, s.rb * scale};
}

// ---------------------------------------------------------------- rays

/// A ray near a segment: from `origin`, relative to the first sphere and near the axis, along the
/// unit `direction`.
template <class F>
struct NearRay {
  Vec3<F> origin, direction;
  F begin;  // where the ray itself begins, along it
};

/// Goes along a ray to where it is nearest to the axis: what squares subtract from each other there
/// is of the segment's size. False where the ray passes outside of a sphere about the segment.
template <class F>
KERNEL bool approach(const RoundSegmentOf<F>& s, const ConeOf<F>& cone, NearRay<F>& ray) {
  const F reach = F(0.5) * cone.length + max2(s.ra, s.rb);
  const Vec3<F> d = ray.direction;
  const F to_middle = dot(s.ab * F(0.5) - ray.origin, d);
  Vec3<F> w = ray.origin + d * to_middle;
  const Vec3<F> beside = w - s.ab * F(0.5);
  if (!(dot(beside, beside) <= reach * reach * F(1 + 0x1p-18))) return false;
  const Vec3<F> across = d - cone.axis * dot(d, cone.axis);
  const Vec3<F> off = w - cone.axis * dot(w, cone.axis);
  const F square = dot(across, across);
  F further = square > 0 ? -dot(off, across) / square : F(0);
  further = min2(max2(further, -reach), reach);
  ray.origin = w + d * further;
  ray.begin = -(to_middle + further);
  return true;
}

/// Piece of a segment's surface that a ray crosses: the first sphere, the cone, or the second
/// sphere.
enum class SegmentPart : u8 { kFirst, kCone, kSecond };

/// Where a ray enters a segment and where it leaves it, along a NearRay. The segment is convex and
/// the union of both spheres and the cone between them, so these are the least and the greatest of
/// the distances at which the ray crosses any of them.
template <class F>
struct Crossings {
  F at[2] = {F(INFINITY), F(-INFINITY)};
  SegmentPart part[2] = {SegmentPart::kCone, SegmentPart::kCone};
  KERNEL void add(F t, SegmentPart of) {
    if (t < at[0]) {
      at[0] = t;
      part[0] = of;
    }
    if (t > at[1]) {
      at[1] = t;
      part[1] = of;
    }
  }
};

/// center   relative to the first sphere
template <class F>
KERNEL void cross_sphere(const NearRay<F>& ray, Vec3<F> center, F radius, SegmentPart part,
                         Crossings<F>& out) {
  const Vec3<F> m = ray.origin - center;
  const F middle = -dot(m, ray.direction);
  const Vec3<F> nearest = m + ray.direction * middle;
  const F left = radius * radius - dot(nearest, nearest);
  if (!(left >= 0)) return;
  const F half = std::sqrt(left);
  out.add(middle - half, part);
  out.add(middle + half, part);
}

/// The part of the cone between the circles where it touches the spheres. With rho the distance
/// from the axis and z along it, its points have cosine rho + sine z = ra.
template <class F>
KERNEL void cross_cone(const RoundSegmentOf<F>& s, const ConeOf<F>& cone, const NearRay<F>& ray,
                       Crossings<F>& out) {
  const F along = dot(ray.direction, cone.axis), z = dot(ray.origin, cone.axis);
  const Vec3<F> across = ray.direction - cone.axis * along, off = ray.origin - cone.axis * z;
  const F leans = cone.sine * along, cosine2 = cone.cosine * cone.cosine;
  const F height = s.ra - cone.sine * z, rho = cone.cosine * std::sqrt(dot(off, off));
  const F a = cosine2 * dot(across, across) - leans * leans;
  const F b = cosine2 * dot(off, across) + height * leans;
  const F c = (rho - height) * (rho + height);
  const F h = b * b - a * c;
  if (!(h >= 0)) return;
  const F q = -(b + std::copysign(std::sqrt(h), b));
  const auto add = [&](F t) {
    const F from_circle = z + along * t - cone.sine * s.ra;
    if (from_circle >= 0 && from_circle <= cone.length * cosine2) out.add(t, SegmentPart::kCone);
  };
  add(q / a);
  add(c / q);
}

// ---------------------------------------------------------------- places

/// A unit vector across the segment at which v is 0. That of the mesh at rest turns with the
/// segment by the shortest way, so that a place follows what deforms.
template <class F>
KERNEL Vec3<F> zero_of(const MeshView& mesh, uvec3 points, Vec3<F> axis) {
  const vec3* rest = mesh.rest_positions ? mesh.rest_positions : mesh.positions;
  const Vec3<F> a(rest[points.x]);
  const RoundSegmentOf<F> before{a, Vec3<F>(rest[points.y]) - a, F(0), F(0)};
  const Vec3<F> from = cone_of(scaled(before, scale_of(before))).axis;
  const Vec3<F> given(mesh.strand_points[points.x]);
  const Vec3<F> flat = given - from * dot(given, from);
  const F length2 = dot(flat, flat);
  const Vec3<F> zero =
      length2 > F(1e-6) ? flat / std::sqrt(length2) : Vec3<F>(make_frame(vec3(from)).s);
  const F opposite = 1 + dot(from, axis);
  if (from == axis || !(opposite > 0)) return zero;
  const Vec3<F> turned = zero - (from + axis) * (dot(axis, zero) / opposite);
  return turned / std::sqrt(dot(turned, turned));
}

/// The angle in turns at which a vector is that goes `across` an axis and `along` it.
KERNEL float turns_of(float across, float along) { return atan2_turns(across, along); }
KERNEL double turns_of(double across, double along) {
  return std::atan2(across, along) * (0.5 / 3.14159265358979323846);
}

/// p   of the surface, relative to the first sphere
template <class F>
KERNEL Vec2<F> place_of(const RoundSegmentOf<F>& s, const ConeOf<F>& cone, SegmentPart part,
                        Vec3<F> p, Vec3<F> zero) {
  const Vec3<F> m = part == SegmentPart::kSecond ? p - s.ab : p;
  const F z = dot(m, cone.axis);
  const Vec3<F> off = m - cone.axis * z;
  F v = turns_of(dot(off, cross(zero, cone.axis)), dot(off, zero));
  if (v < 0) v = min2(v + 1, F(1 - 0x1p-24));
  if (part == SegmentPart::kCone) {
    const F cosine2 = cone.cosine * cone.cosine;
    return {clamp01((z - cone.sine * s.ra) / (cosine2 * cone.length)), v};
  }
  const F side = part == SegmentPart::kFirst ? F(-1) : F(1);
  const F most = turns_of(cone.cosine, side * cone.sine);
  const F from_pole = turns_of(std::sqrt(dot(off, off)), side * z);
  const F share = most > 0 ? min2(from_pole / most, F(1)) : F(1);
  return {part == SegmentPart::kFirst ? share - 1 : 2 - share, v};
}

/// A point of a segment and its unit normal.
struct SegmentPoint {
  vec3 p;       // relative to the first sphere's centre
  vec3 normal;  // outwards
  vec3 around;  // unit, in which v grows
};
KERNEL SegmentPoint segment_point(const RoundSegment& s, const ConeOf<float>& cone, vec3 zero,
                                  vec2 place) {
  const vec3 side = cross(zero, cone.axis);
  const SinCos turn = sincos_turns(place.y);
  const vec3 out = zero * turn.cos + side * turn.sin, around = side * turn.cos - zero * turn.sin;
  if (place.x >= 0 && place.x <= 1) {
    const vec3 n = out * cone.cosine + cone.axis * cone.sine;
    return {s.ab * place.x + n * (s.ra + (s.rb - s.ra) * place.x), n, around};
  }
  const bool first = place.x < 0;
  const float way = first ? -1.0f : 1.0f, share = first ? 1 + place.x : 2 - place.x;
  const SinCos tilt = sincos_turns(share * turns_of(cone.cosine, way * cone.sine));
  const vec3 n = out * tilt.sin + cone.axis * (way * tilt.cos);
  return {first ? n * s.ra : s.ab + n * s.rb, n, around};
}

// ---------------------------------------------------------------- hits

/// Depth of a point within a segment; below 0: outside.
///
/// p   relative to the first sphere
template <class F>
KERNEL F depth_within(const RoundSegmentOf<F>& s, Vec3<F> p) {
  const ConeOf<F> cone = cone_of(s);
  const F z = dot(p, cone.axis);
  const Vec3<F> off = p - cone.axis * z;
  const F rho = std::sqrt(dot(off, off));
  if (z * cone.cosine <= rho * cone.sine) return s.ra - std::sqrt(dot(p, p));
  if ((z - cone.length) * cone.cosine >= rho * cone.sine) {
    const Vec3<F> from_second = p - s.ab;
    return s.rb - std::sqrt(dot(from_second, from_second));
  }
  return s.ra - (rho * cone.cosine + z * cone.sine);
}

/// Neighbours of a segment that are of the same strand.
struct Neighbours {
  bool before, after;
};
KERNEL Neighbours neighbours_of(const PrimitiveAt& at) {
  const uvec3* segment = at.mesh.triangles + at.primitive;
  return {at.primitive > 0 && segment[-1].y == segment->x,
          at.primitive + 1 < at.mesh.triangle_count && segment[1].x == segment->y};
}

/// True if a point of a segment lies within the segment before or after it: then it is no surface
/// of the strand. A point on both surfaces, within rounding, is one.
///
/// p       relative to the first sphere
/// scale   of `s` and p
template <class F>
KERNEL bool is_inside_strand(const PrimitiveAt& at, const RoundSegmentOf<F>& s, Vec3<F> p,
                             F scale) {
  const auto within = [&](u32 number, Vec3<F> from_shared) {
    const RoundSegmentOf<F> other =
        scaled(round_segment<F>(at.mesh, at.mesh.triangles[number], at.time), scale);
    const F size = max_component(abs(other.ab)) + max_component(abs(s.ab));
    const F rounding = F(0x1p-10) * max2(other.ra, other.rb) + F(0x1p-20) * size;
    const bool is_before = number < at.primitive;
    return depth_within(other, is_before ? from_shared + other.ab : from_shared) > rounding;
  };
  const auto [before, after] = neighbours_of(at);
  return (before && within(at.primitive - 1, p)) || (after && within(at.primitive + 1, p - s.ab));
}

template <class F>
struct SegmentRayOf {
  Vec3<F> origin, direction;  // of any length
  F t_max;
};
template <class F>
struct SegmentHitOf {
  F t;  // in lengths of the direction, in (0, t_max]
  Vec2<F> place;
};

/// Where a ray of object space first meets the surface of a strand on one of its segments, from
/// outside or from within. Segments beside it take away what lies within them.
///
/// After Quilez 2018, "Rounded cone - intersection", for the closed form, and Woop et al. 2014,
/// "Exploiting Local Orientation Similarity for Efficient Ray Traversal of Hair and Fur", HPG, for
/// rays that begin near the segment.
template <class F>
KERNEL bool meet_segment(const PrimitiveAt& at, const SegmentRayOf<F>& ray, SegmentHitOf<F>& hit) {
  const uvec3 points = at.mesh.triangles[at.primitive];
  const RoundSegmentOf<F> whole = round_segment<F>(at.mesh, points, at.time);
  const F scale = scale_of(whole);
  const RoundSegmentOf<F> s = scaled(whole, scale);
  const ConeOf<F> cone = cone_of(s);
  const F shrink = F(scale_near_one(float(max_component(abs(ray.direction)))));
  const Vec3<F> near_one = ray.direction * shrink;
  const F length = std::sqrt(dot(near_one, near_one));
  NearRay<F> near{(ray.origin - whole.a) * scale, near_one / length, F(0)};
  if (!approach(s, cone, near)) return false;
  Crossings<F> crossings;
  cross_sphere(near, Vec3<F>(0), s.ra, SegmentPart::kFirst, crossings);
  cross_sphere(near, s.ab, s.rb, SegmentPart::kSecond, crossings);
  if (cone.cosine > 0) cross_cone(s, cone, near, crossings);
  for (int i = 0; i < 2; ++i) {
    const F t = (crossings.at[i] - near.begin) / length * (shrink / scale);
    if (!(t > 0 && t <= ray.t_max && t < F(INFINITY))) continue;
    const Vec3<F> p = near.origin + near.direction * crossings.at[i];
    // The sphere between two segments is of the one before: no place has two names.
    if (crossings.part[i] == SegmentPart::kFirst && neighbours_of(at).before) continue;
    if (is_inside_strand(at, s, p, scale)) continue;
    hit = {t, place_of(s, cone, crossings.part[i], p, zero_of(at.mesh, points, cone.axis))};
    return true;
  }
  return false;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
