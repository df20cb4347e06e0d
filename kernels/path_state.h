// A path under way, and the steps that vertices on surfaces and in media share. Called by path.h
// and path_volume.h.
#pragma once

#include "kernels/blur.h"
#include "kernels/light.h"
#include "kernels/sample.h"
#include "kernels/sampler.h"
#include "kernels/volume.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Pairs of random numbers that a path takes: the filter, the time, the lens, then these at every
/// vertex.
enum Dimension : u32 {
  kFilterPair = 0,
  kFirstVertexPair = 1,
  kTimePair = 1u << 24,
  kLensPair = kTimePair + 1,
};
enum VertexDimension : u32 { kLightPair, kScatterPair, kLightChoice, kLobeChoice, kVertexPairs };
/// Numbers of unstratified random choices.
enum Hashed : u32 {
  kHoleHash = 0,
  kShadowHoleHash = 64,
  kRouletteHash = 128,
  kOcclusionHash = 192,
  kCollisionHash = 4096,
  kShadowCollisionHash = 8192
};

/// What every step needs and none changes.
template <Tracer T>
struct PathContext {
  const SceneView& scene;
  const CameraView& camera;  // at that time
  const Settings& settings;
  const T& tracer;
  const FilmView& film;
  Sampler sampler;
  float time;  // of the path, with all that it meets
  u64 pixel;
};

/// A path on its way from the camera.
struct Path {
  Ray ray;
  u32 mask;  // kind of the ray
  vec3 throughput;
  float pdf;      // 1/sr, with which the ray's direction was chosen; 0: no light sampling competes
  Receiver from;  // where it was chosen; unset for camera rays
  float radiance_scale;  // product of eta^2 of refractions: throughput without them, for roulette
  u32 edges;             // of the path, the ray included
  bool guided;           // the guides are recorded
  Cone cone;             // of the ray
  bool blurred;          // it has scattered, and not by a perfect mirror or window alone
  Route route;
};

template <Tracer T>
KERNEL HoleKey hole_key(const PathContext<T>& c, u32 number) {
  return {c.scene.any_holes ? c.sampler.hash_of(number) : 0, false};
}

KERNEL u32 vertex_pair(const Path& path, u32 dimension) {
  return kFirstVertexPair + (path.edges - 1) * kVertexPairs + dimension;
}

/// Counts light that has reached the camera.
template <Tracer T>
KERNEL void collect(const PathContext<T>& c, SampleValues& sample, Contribution light,
                    const Route& route) {
  const float largest = max_component(light.radiance);
  if (!(largest > 0)) return;
  const float most = light.edges > 2 ? c.settings.clamp_indirect : c.settings.clamp;
  if (largest > most) light.radiance *= most / largest;
  sample.radiance += light.radiance;
  if (wants(c.film, Plane::BEAUTY_GROUP)) {
    add_to_group(c.film, light.group, c.pixel, light.radiance);
  }
  if (c.film.wanted & kLightPlaneSet) add_light(sample, light, route);
}

/// Chooses a light for the path's vertex; false when none sends light there.
template <Tracer T>
KERNEL bool choose_light(const PathContext<T>& c, const Path& path, const Receiver& at,
                         LightSample& light) {
  const float choice = c.sampler.get1(vertex_pair(path, kLightChoice));
  const vec2 u = c.sampler.get2(vertex_pair(path, kLightPair));
  return sample_light(c.scene, at, choice, u, light);
}

/// What a vertex makes of a sampled light's radiance.
struct Scattered {
  vec3 value;  // 1/sr, BSDF times cosine, or phase function times albedo
  float pdf;   // 1/sr, with which the vertex would have taken that direction
  Route route;
};

/// Counts light that comes to a vertex straight from one light, if nothing stands in the way.
template <Tracer T>
KERNEL void receive_light(const PathContext<T>& c, const Path& path, const LightSample& light,
                          vec3 origin, const Scattered& f, SampleValues& sample) {
  Ray ray{vec3(0), vec3(0), 0, c.time, hole_key(c, kShadowHoleHash + path.edges)};
  if (!shadow_ray(origin, light, ray)) return;
  ++sample.rays;
  if (c.tracer.occluded(ray, kShadowRay)) return;
  float weight = shows_to_all(light.visibility) ? mis_weight(light.pdf, f.pdf) : 1;
  if (c.scene.volume_count > 0) {
    weight *= transmittance(c.scene, ray, c.sampler.hash_of(kShadowCollisionHash + path.edges));
    if (!(weight > 0)) return;
  }
  const vec3 radiance =
      path.throughput * f.value * light_radiance(c.scene, light) * (weight / light.pdf);
  const Route& route = path.edges == 1 ? f.route : path.route;
  const u32 group = light_group(c.scene, light);
  collect(c, sample, {radiance, path.edges + 1, light.light == kNone, group}, route);
}

/// Ends the path by chance where it carries little; unbiased.
template <Tracer T>
KERNEL bool survives(const PathContext<T>& c, Path& path) {
  if (!c.settings.roulette || path.edges <= 4) return true;
  const float chance = max_component(path.throughput) * path.radiance_scale;
  if (chance >= 1) return true;
  if (unit_float(c.sampler.hash_of(kRouletteHash + path.edges)) >= chance) return false;
  path.throughput *= 1 / chance;
  return true;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
