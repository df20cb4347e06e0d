// Directions to lights that are shapes, and the cones of spot lights. Called by light.h.
//
// Each shape has
//   sample_point(Shape, at, from, u, out)                a point that a receiver may see
//   point_pdf(Shape, at, from, direction, distance)      the density of a direction to one, 1/sr
#pragma once

#include "kernels/geometry/shape.h"
#include "kernels/light/light_triangle.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Share of its radiance that a light sends in a direction: 1 unless it has a cone.
///
/// out      unit, world, leaves the light
/// Source: KHR_lights_punctual, "Inner and Outer Cone Angles".
KERNEL float cone_share(const LightView& light, const mat4x3& world_from_object, vec3 out) {
  if (light.cone_scale == 0) return 1;
  const vec3 axis = normalize_or(-world_from_object[2], vec3(0, 0, -1));
  return sqr(clamp01((dot(out, axis) - light.cone_cos) * light.cone_scale));
}

/// A point of a shape in object space, and the density of its direction.
struct ShapePoint {
  vec3 p;
  float pdf;  // 1/sr, in the world
};

// ---------------------------------------------------------------- spheres

/// Density of a direction to the unit sphere from a point of object space, 1/sr there: uniform in
/// the cone that the sphere fills, in all directions from within.
KERNEL float sphere_pdf(float distance2) {
  if (distance2 <= 1) return 0.25f * kInvPi;
  return (distance2 + std::sqrt(distance2 * (distance2 - 1))) * (0.5f * kInvPi);
}

/// From a density of directions in object space to one in the world: the direction of `d` there is
/// that of world_from_object * d here.
KERNEL float turned_pdf(const mat4x3& m, vec3 d, float pdf) {
  const float stretch = dot(transform_vector(m, d), transform_vector(m, d)) / dot(d, d);
  const float volume = std::fabs(dot(m[0], cross(m[1], m[2])));
  return pdf * stretch * std::sqrt(stretch) / volume;
}

/// A direction towards a sphere that is seen from outside.
template <class F>
struct SphereDirection {
  Vec3<F> normal;  // unit, of the sphere, where the direction meets it
  F pdf;           // 1/sr
};
/// Uniform in the cone that the sphere fills.
///
/// d          from the point to the sphere's centre, longer than its radius
/// Source: Pharr, Jakob and Humphreys 2023, "Physically Based Rendering", 4th edition, section
/// 6.2.4, for the point at which a direction of the cone meets the sphere.
template <class F>
KERNEL SphereDirection<F> sample_sphere_seen(Vec3<F> d, F radius, Vec2<F> u) {
  const F scale = 1 / radius;
  const F distance2 = dot(d, d) * sqr(scale);  // in radii
  const F distance = sqrt(distance2);
  const F sine2_max = 1 / distance2;
  const F drop = u.x * sine2_max / (1 + sqrt(1 - sine2_max));
  const F sine2 = drop * (2 - drop);
  const F cosine = sine2 * distance + (1 - drop) * safe_sqrt(1 - sine2 * distance2);
  const F sine = safe_sqrt(1 - cosine * cosine);
  const SinCosOf<F> phi = sincos_turns(u.y);
  const FrameOf<F> frame = make_frame(d * (-scale / distance));
  return {to_world(frame, Vec3<F>(sine * phi.cos, sine * phi.sin, cosine)),
          (distance2 + sqrt(distance2 * (distance2 - 1))) * (0.5f * kInvPi)};
}

/// plane_error() of a sphere's points.
template <class F>
KERNEL F sphere_error(Vec3<F> center, F radius, Vec3<F> n) {
  const Vec3<F> bound(abs(center.x) + 2 * radius, abs(center.y) + 2 * radius,
                      abs(center.z) + 2 * radius);
  return 0x1p-19f * (abs(n.x) * bound.x + abs(n.y) * bound.y + abs(n.z) * bound.z +
                     0.0625f * max_component(bound));
}

/// Samples a sphere that may be uneven, in object space.
KERNEL bool sample_point(Sphere, const LightPlace& at, vec3 from, vec2 u, ShapePoint& out) {
  const vec3 origin = transform_point(at.pose.object_from_world, from);
  const float distance2 = dot(origin, origin);
  if (distance2 > 1) {
    out.p = sample_sphere_seen(-origin, 1.0f, u).normal;
  } else {
    if (!emits_back(at.light)) return false;
    const vec3 d = sample_sphere(u);
    ShapeHit hit;
    if (!meet_sphere({origin, d, INFINITY}, hit)) return false;
    out.p = sphere_point(hit.place);
  }
  out.pdf = turned_pdf(at.pose.world_from_object, out.p - origin, sphere_pdf(distance2));
  return true;
}

KERNEL float point_pdf(Sphere, const LightPlace& at, vec3 from, vec3 direction, float) {
  const vec3 origin = transform_point(at.pose.object_from_world, from);
  const vec3 d = transform_vector(at.pose.object_from_world, direction);
  return turned_pdf(at.pose.world_from_object, d, sphere_pdf(dot(origin, origin)));
}

// ---------------------------------------------------------------- discs

/// True if a disc looks so large from a point of object space that it is sampled by solid angle.
KERNEL bool is_near_disc(vec3 origin) { return dot(origin, origin) < 4; }

/// The square about a disc, in two halves.
struct DiscSquare {
  SphereTriangle half[2];
  KERNEL float solid_angle() const { return half[0].solid_angle + half[1].solid_angle; }
};
KERNEL DiscSquare disc_square(const mat4x3& m, vec3 from) {
  const vec3 x = 2.0f * m[0], y = 2.0f * m[1];
  const vec3 low = m[3] - m[0] - m[1], high = m[3] + m[0] + m[1];
  return {{sphere_triangle(low, x, y, from), sphere_triangle(high, -x, -y, from)}};
}

/// Density of a direction to a point of the disc, chosen by area.
KERNEL float disc_area_pdf(const mat4x3& m, vec3 d, float distance) {
  const float projected = kPi * std::fabs(dot(cross(m[0], m[1]), d));
  return projected > 0 ? sqr(distance) / projected : 0;
}

/// Uniform in the solid angle of the square about it where it is near; directions that miss the
/// disc bring no light. By area where it is far.
///
/// Source: Gamito 2016, "Solid Angle Sampling of Disk and Cylinder Lights", section 3, without
/// drawing again.
KERNEL bool sample_point(Disc, const LightPlace& at, vec3 from, vec2 u, ShapePoint& out) {
  const mat4x3& world = at.pose.world_from_object;
  const vec3 origin = transform_point(at.pose.object_from_world, from);
  if (origin.z >= 0 && !emits_back(at.light)) return false;
  if (!is_near_disc(origin)) {
    out.p = vec3(sample_disk(u), 0);
    const vec3 d = transform_point(world, out.p) - from;
    const float distance = length(d);
    out.pdf = disc_area_pdf(world, d / distance, distance);
    return true;
  }
  const DiscSquare square = disc_square(world, from);
  const float all = square.solid_angle();
  float rest = u.x * all;
  const u32 half = rest < square.half[0].solid_angle ? 0 : 1;
  if (half) rest -= square.half[0].solid_angle;
  const SphereTriangle& seen = square.half[half];
  const vec3 d = sample_sphere_triangle(seen, vec2(min2(rest / seen.solid_angle, 1.0f), u.y));
  ShapeHit hit;
  const vec3 d_object = transform_vector(at.pose.object_from_world, d);
  if (!meet_disc({origin, d_object, INFINITY}, hit)) return false;
  out.p = disc_point(hit.place);
  out.pdf = 1 / all;
  return true;
}

KERNEL float point_pdf(Disc, const LightPlace& at, vec3 from, vec3 direction, float distance) {
  const mat4x3& world = at.pose.world_from_object;
  if (!is_near_disc(transform_point(at.pose.object_from_world, from))) {
    return disc_area_pdf(world, direction, distance);
  }
  return 1 / disc_square(world, from).solid_angle();
}

// ---------------------------------------------------------------- all shapes

HELIO_GPU_NOINLINE KERNEL bool sample_shape(const LightPlace& at, vec3 from, vec2 u,
                                            ShapePoint& out) {
  return with_shape(at.mesh.shape, [&](auto of) { return sample_point(of, at, from, u, out); });
}

/// Density [1/sr] with which sample_shape() takes the direction to a point at a distance.
HELIO_GPU_NOINLINE KERNEL float shape_pdf(const LightPlace& at, vec3 from, vec3 direction,
                                          float distance) {
  return with_shape(at.mesh.shape,
                    [&](auto of) { return point_pdf(of, at, from, direction, distance); });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
