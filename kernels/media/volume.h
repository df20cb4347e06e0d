// Heterogeneous media: where a ray collides in them, how much light passes, what glows. Called by
// path.h and probe.h.
//
// Extinction is the sum of that of all volumes. Each is tracked by itself: of independent free
// paths the shortest is distributed like the free path in the sum, and it ends in each volume with
// the probability of its share; transmittances multiply.
#pragma once

#include "kernels/core/hash.h"
#include "kernels/geometry/motion.h"
#include "kernels/media/volume_tree.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Random numbers without an end, from a seed.
class HashSequence {
 public:
  KERNEL explicit HashSequence(u32 seed) : state_(hash32(seed)) {}
  /// Uniform in [0, 1).
  KERNEL float next() {
    state_ += 0x9e3779b9u;
    return unit_float(hash32(state_));
  }
  /// Exponential with mean 1.
  KERNEL float next_exponential() { return -std::log(1 - next()); }

 private:
  u32 state_;
};

/// A ray in a volume's object space.
KERNEL GridRay to_volume(const SceneView& scene, const VolumeView& volume, const Ray& ray) {
  const mat4x3 object_from_world = pose_at(scene, volume.instance, ray.time).object_from_world;
  return {transform_point(object_from_world, ray.origin),
          transform_vector(object_from_world, ray.direction)};
}

KERNEL float extinction_at(const VolumeView& volume, const GridRay& ray, float t) {
  return volume.density_scale * interpolate_grid<1>(volume.density, ray.at(t)).channel[0];
}

/// Steps of a walk are at least this share of a cell, so that no majorant makes them without end.
inline constexpr float kLeastStep = 0x1p-14f;

/// Visits the tentative collisions of a ray before t_max, by the majorant of each cell, until
/// visit(t, majorant) is true. The true ones among them have the share extinction / majorant.
///
/// Source: Woodcock et al. 1965 (delta tracking), with the majorant of each cell: Szirmay-Kalos et
/// al. 2011, "Free Path Sampling in High Resolution Inhomogeneous Participating Media".
template <class Visit>
KERNEL void visit_collisions(const VolumeView& volume, const GridRay& ray, float t_max,
                             HashSequence& random, const Visit& visit) {
  CellWalk walk(volume.density, ray, span_in_box(volume.density, ray, t_max));
  float depth = random.next_exponential();
  Span span;
  for (u64 row; walk.next(span, row);) {
    const float majorant = volume.density.majorants[row] * volume.density_scale;
    if (!(majorant > 0)) continue;
    const float least = (span.end - span.begin) * kLeastStep;
    for (float t = span.begin;;) {
      const float step = max2(depth / majorant, least);
      if (!(t + step < span.end)) {
        depth -= majorant * (span.end - t);
        break;
      }
      t += step;
      if (visit(t, majorant)) return;
      depth = random.next_exponential();
    }
  }
}

/// Distance to the first collision before t_max; t_max when there is none.
KERNEL float collide(const SceneView& scene, const VolumeView& volume, const Ray& world,
                     float t_max, HashSequence random) {
  const GridRay ray = to_grid(volume.density.voxel_from_object, to_volume(scene, volume, world));
  float first = t_max;
  visit_collisions(volume, ray, t_max, random, [&](float t, float majorant) {
    const bool collides = random.next() * majorant < extinction_at(volume, ray, t);
    if (collides) first = t;
    return collides;
  });
  return first;
}

/// An unbiased estimate of exp(- optical depth) up to t_max.
///
/// Source: Novák, Selle and Jarosz 2014, "Residual Ratio Tracking for Estimating Attenuation in
/// Participating Media", section 4 (ratio tracking), with Russian roulette.
KERNEL float transmittance(const SceneView& scene, const VolumeView& volume, const Ray& world,
                           HashSequence random) {
  constexpr float kFaint = 0.1f;
  const GridRay ray = to_grid(volume.density.voxel_from_object, to_volume(scene, volume, world));
  float result = 1;
  visit_collisions(volume, ray, world.t_max, random, [&](float t, float majorant) {
    result *= max2(1 - extinction_at(volume, ray, t) / majorant, 0.0f);
    if (result < kFaint) result = random.next() * kFaint < result ? kFaint : 0;
    return result == 0;
  });
  return result;
}

/// Where a path collides.
struct Collision {
  u32 volume;  // kNone: nowhere
  float t;     // metres along the ray
};

/// The nearest collision of a ray of these kinds before t_max.
HELIO_GPU_NOINLINE KERNEL Collision collide(const SceneView& scene, const Ray& ray, u32 mask,
                                            float t_max, u32 seed) {
  Collision nearest{kNone, t_max};
  visit_volumes(scene, ray, mask, t_max, [&](u32 i, float& end) {
    const float t = collide(scene, scene.volumes[i], ray, end, HashSequence(seed + i));
    if (t < end) nearest = {i, t};
    end = nearest.t;
    return true;
  });
  return nearest;
}

/// The share of light that passes all volumes on a shadow ray.
HELIO_GPU_NOINLINE KERNEL float transmittance(const SceneView& scene, const Ray& ray, u32 seed) {
  float result = 1;
  visit_volumes(scene, ray, kShadowRay, ray.t_max, [&](u32 i, float&) {
    result *= transmittance(scene, scene.volumes[i], ray, HashSequence(seed + i));
    return result > 0;
  });
  return result;
}

// ---------------------------------------------------------------- what is there

/// Radiance of a black body, W sr^-1 m^-2.
///
/// Source: Planck's law. The logarithm of its luminance is nearly linear in 1 / kelvin (Wien).
KERNEL vec3 black_body(const SceneView& scene, float kelvin) {
  if (!(kelvin > kColdestBlackBody)) return vec3(0);
  const float x = 1 / (kelvin * kBlackBodyStep);
  const u32 i = min2(u32(x), kBlackBodyEntries - 2);
  const vec4 entry = glm::mix(scene.black_body[i], scene.black_body[i + 1], x - float(i));
  return vec3(entry) * std::exp(entry.w);
}

/// The medium at a point of a volume.
struct Medium {
  vec3 albedo;
  vec3 emission;  // radiance that a collision there gives off, W sr^-1 m^-2
};

HELIO_GPU_NOINLINE KERNEL Medium medium_at(const SceneView& scene, const VolumeView& volume,
                                           const Ray& world, float t) {
  const GridRay ray = to_volume(scene, volume, world);
  Medium medium{volume.albedo, vec3(0)};
  if (volume.color.values) {
    const vec3 p = to_grid(volume.color.voxel_from_object, ray).at(t);
    const Values<3> color = interpolate_grid<3>(volume.color, p);
    medium.albedo *= vec3(color.channel[0], color.channel[1], color.channel[2]);
  }
  if (volume.emission_scale > 0) {
    const vec3 p = to_grid(volume.temperature.voxel_from_object, ray).at(t);
    const float kelvin =
        volume.temperature_scale * interpolate_grid<1>(volume.temperature, p).channel[0];
    medium.emission = (vec3(1) - medium.albedo) * black_body(scene, kelvin) * volume.emission_scale;
  }
  return medium;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
