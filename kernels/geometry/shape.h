// Shapes that are no triangles: where rays meet them. Called by tracers, surface.h and
// light_shape.h.
//
// In object space a disc is the unit disc in the plane z = 0, its front towards -z, and a sphere
// the unit sphere about the origin. Each is the primitive 0 of a mesh whose one triangle carries
// the corners of texture space; a point of it is named by a place, (u, v) in [0, 1]^2.
//
// A shape has a type with
//   kRound               whether it is more than its triangle's plane
//   reach()              half of its box, which has the origin in its middle
//   meet(ray, hit)       where a ray meets it first
//   point(place)         the point at a place, and place(p) the other way
//   normal(p)            unit, of its front
// How light that it emits is sampled is in kernels/light/light_shape.h.
#pragma once

#include "kernels/core/math.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// True if a mesh is one of these: it has one primitive, and no tree over it.
KERNEL bool is_whole(Shape shape) { return shape == Shape::kDisc || shape == Shape::kSphere; }

/// The point of the unit disc at a place. Seen from its front with +y up, u goes to the right.
KERNEL vec3 disc_point(vec2 place) { return vec3(1 - 2 * place.x, 2 * place.y - 1, 0); }
KERNEL vec2 disc_place(vec3 p) { return vec2(0.5f - 0.5f * p.x, 0.5f + 0.5f * p.y); }

/// The point of the unit sphere at a place: u = 0.5 - atan2(y, x) / 2 pi, v from -z to +z.
KERNEL vec3 sphere_point(vec2 place) {
  const SinCos theta = sincos_turns(0.5f - 0.5f * place.y);
  const SinCos phi = sincos_turns(0.5f - place.x);
  return vec3(theta.sin * phi.cos, theta.sin * phi.sin, theta.cos);
}
KERNEL vec2 sphere_place(vec3 p) {
  const float sine = std::sqrt(p.x * p.x + p.y * p.y);
  return vec2(0.5f - atan2_turns(p.y, p.x), 1 - 2 * atan2_turns(sine, p.z));
}

/// A ray of object space; its direction has any length.
struct ShapeRay {
  vec3 origin, direction;
  float t_max;
};
struct ShapeHit {
  float t;  // in lengths of the direction
  vec2 place;
};

KERNEL bool meet_disc(const ShapeRay& ray, ShapeHit& hit) {
  const float t = -ray.origin.z / ray.direction.z;
  if (!(t > 0 && t < ray.t_max)) return false;
  const vec3 p = ray.origin + ray.direction * t;
  if (p.x * p.x + p.y * p.y > 1) return false;
  hit = {t, disc_place(p)};
  return true;
}

/// Source: Haines, Günther and Akenine-Möller 2019, "Precision Improvements for Ray/Sphere
/// Intersection", Ray Tracing Gems chapter 7.
KERNEL bool meet_sphere(const ShapeRay& ray, ShapeHit& hit) {
  const auto& [origin, direction, t_max] = ray;
  const float a = dot(direction, direction);
  const float b = -dot(origin, direction);
  const vec3 nearest = origin + direction * (b / a);
  const float left = 1 - dot(nearest, nearest);
  if (!(left >= 0)) return false;
  const float q = b + std::copysign(std::sqrt(a * left), b);
  const float one = (dot(origin, origin) - 1) / q;
  const float other = q / a;
  const float first = min2(one, other);
  const float t = first > 0 ? first : max2(one, other);
  if (!(t > 0 && t < t_max)) return false;
  hit = {t, sphere_place(normalize_or(origin + direction * t, vec3(0, 0, 1)))};
  return true;
}

struct Disc {
  static constexpr bool kRound = false;
  KERNEL static vec3 reach() { return vec3(1, 1, 0); }
  KERNEL static bool meet(const ShapeRay& ray, ShapeHit& hit) { return meet_disc(ray, hit); }
  KERNEL static vec3 point(vec2 place) { return disc_point(place); }
  KERNEL static vec2 place(vec3 p) { return disc_place(p); }
  KERNEL static vec3 normal(vec3) { return vec3(0, 0, -1); }
};

struct Sphere {
  static constexpr bool kRound = true;
  KERNEL static vec3 reach() { return vec3(1); }
  KERNEL static bool meet(const ShapeRay& ray, ShapeHit& hit) { return meet_sphere(ray, hit); }
  KERNEL static vec3 point(vec2 place) { return sphere_point(place); }
  KERNEL static vec2 place(vec3 p) { return sphere_place(p); }
  KERNEL static vec3 normal(vec3 p) { return p; }
};

/// Calls f with the type of a shape.
template <class F>
KERNEL auto with_shape(Shape shape, const F& f) {
  return shape == Shape::kDisc ? f(Disc{}) : f(Sphere{});
}

KERNEL bool is_round(Shape shape) {
  return is_whole(shape) && with_shape(shape, [](auto of) { return decltype(of)::kRound; });
}
KERNEL vec3 shape_reach(Shape shape) {
  return with_shape(shape, [](auto of) { return decltype(of)::reach(); });
}
KERNEL bool meet_shape(Shape shape, const ShapeRay& ray, ShapeHit& hit) {
  return with_shape(shape, [&](auto of) { return decltype(of)::meet(ray, hit); });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
