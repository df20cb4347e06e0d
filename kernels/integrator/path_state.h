// A path on its way: what its steps share, its random numbers and what it brings home. Called by
// the steps in path.h, direct_light.h and medium_path.h.
#pragma once

#include "kernels/bsdf/blur.h"
#include "kernels/bsdf/dispersion.h"
#include "kernels/core/sampler.h"
#include "kernels/integrator/sample.h"
#include "kernels/light/light.h"
#include "kernels/media/inside.h"
#include "kernels/media/volume.h"
#include "kernels/scene/settings.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Pairs of random numbers that a path takes: the filter, the time, the lens, the wavelength, then
/// these at every vertex; and those of flights through media.
enum Dimension : u32 {
  kFilterPair = 0,
  kFirstVertexPair = 1,
  kTimePair = 1u << 24,
  kLensPair = kTimePair + 1,
  kWavelengthPair = kTimePair + 2,
  kFirstFlightPair = 1u << 25
};
enum VertexDimension : u32 {
  kLightPair,    // a light and a direction to it
  kScatterPair,  // a direction in which the path goes on
  kChancePair,   // x: which of the surface's lobes; y: whether the path survives
  kVertexPairs
};
/// Numbers of unstratified random choices.
enum Hashed : u32 {
  kHoleHash = 0,
  kShadowHoleHash = 64,
  kOcclusionHash = 192,
  kCollisionHash = 4096,
  kShadowCollisionHash = 8192,
  kWalkHash = 12288
};

/// Inputs of every step, which none changes.
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

/// The ray of a path, which a tracer follows. A GPU moves it, and PathState, in words of 16 bytes.
struct alignas(16) PathRay {
  Ray ray;
  float surface_share;  // of the receiver where it was chosen
  u8 mask;              // kind of the ray
  u8 boundaries;        // passable ones since the last vertex
  Facing from_facing;   // of the receiver
  u8 guided : 1;        // the guides are recorded
  u8 blurred : 1;       // it has scattered, and not by a perfect mirror or window alone
  u8 dispersed : 1;     // it carries the colour of its wavelength
};

/// State that a path has beside its ray, its route and what it is inside of.
struct alignas(16) PathState {
  vec3 throughput;
  float pdf;    // 1/sr, with which the ray's direction was chosen; 0: no light sampling competes
  vec3 from_p;  // of the receiver where it was chosen; unset for camera rays
  float radiance_scale;  // product of eta^2 of refractions: throughput without them, for roulette
  vec3 from_n;
  float passed;  // metres, from the last vertex to the ray's origin
  Cone cone;     // of the ray
  u32 edges;     // of the path, the ray included
};
static_assert(kMostPassed < 255 && kThroughRay < 256);
static_assert(sizeof(PathRay) == 48 && sizeof(PathState) == 64);

/// A path on its way from the camera.
struct Path : PathRay, PathState {
  Route route;
  Inside inside;  // of which closed surfaces the ray starts
};

/// Where the ray's direction was chosen.
KERNEL Receiver receiver_of(const Path& path) {
  return {path.from_p, path.from_n, path.from_facing, path.ray.time, path.surface_share};
}

/// Factors that paths carry.
template <class F>
struct CarriedOf {
  Vec3<F> throughput;
  F radiance_scale;  // as Path has it
};
KERNEL CarriedOf<float> carried_by(const Path& path) {
  return {path.throughput, path.radiance_scale};
}

template <Tracer T>
KERNEL HoleKey hole_key(const PathContext<T>& c, u32 number) {
  return {c.scene.any_holes ? c.sampler.hash_of(number) : 0, false};
}

/// Pair of a dimension of the vertex at the end of the path's ray.
KERNEL u32 vertex_pair(const Path& path, u32 dimension) {
  return kFirstVertexPair + (path.edges - 1) * kVertexPairs + dimension;
}

/// The pair of a flight through the medium that the ray starts in.
KERNEL u32 flight_pair(const Path& path) {
  return kFirstFlightPair + path.edges * (kMostPassed + 1) + path.boundaries;
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
  if (wants_rich(c.film, plane_bit(Plane::BEAUTY_GROUP))) {
    add_to_group(c.film, light.group, c.pixel, light.radiance);
  }
  if (wants_rich(c.film, kLightPlaneSet)) add_light(sample, light, route);
}

/// How a path leaves a vertex, but for where it goes.
struct Leave {
  float pdf;     // 1/sr; 0: no light sampling competes
  float spread;  // lobe_spread() of it
  u32 mask;
  Facing facing;  // of the receiver
  float surface_share;
};
template <Tracer T>
KERNEL void leave(const PathContext<T>& c, Path& path, const Leave& how) {
  path.blurred |= how.pdf > 0;
  path.cone.spread = max2(path.cone.spread, how.spread);
  path.from_facing = how.facing;
  path.surface_share = how.surface_share;
  path.mask = u8(how.mask);
  path.ray.holes = hole_key(c, kHoleHash + path.edges);
  path.boundaries = 0;
  ++path.edges;
}

/// The path goes on from a vertex: where to, by what density and kind of ray.
struct Onward {
  vec3 origin;
  vec3 direction;  // unit, world
  float pdf;       // 1/sr; 0: no light sampling competes
  float spread;    // lobe_spread() of it
  u32 mask;
  Receiver from;
};
template <Tracer T>
KERNEL void go_on(const PathContext<T>& c, Path& path, const Onward& onward) {
  path.pdf = onward.pdf;
  path.from_p = onward.from.p;
  path.from_n = onward.from.n;
  path.passed = 0;
  path.ray.origin = onward.origin;
  path.ray.direction = onward.direction;
  path.ray.t_max = INFINITY;
  path.ray.time = c.time;
  leave(c, path,
        {onward.pdf, onward.spread, onward.mask, onward.from.facing, onward.from.surface_share});
}

/// Chance with which a path that carries so much goes on. The root lets fewer live paths end than
/// what they carry: they carry what the many that ended would have.
template <class F>
KERNEL F survival_chance(F carried) {
  return min2(sqrt(carried), F(1));
}
/// Ends paths by chance where they carry little; unbiased. Returns which go on.
///
/// begun   where roulette has
/// u()     uniform in [0, 1)
template <class F, class U>
KERNEL BoolOf<F> survives(Vec3<F>& throughput, F radiance_scale, BoolOf<F> begun, const U& u) {
  if (!any(begun)) return true;
  const F carried = survival_chance(F(max_component(throughput) * radiance_scale));
  const F chance = select(begun, carried, F(1));
  if (all(chance >= 1)) return true;
  throughput *= 1 / chance;
  return u() < chance;
}

/// True if there is roulette at the path's vertex.
KERNEL bool roulette_begins(const Settings& settings, const Path& path) {
  return path.edges >= settings.roulette_depth;
}

/// Roulette of a path that has gone on. False: it ends.
template <Tracer T>
KERNEL bool survives(const PathContext<T>& c, Path& path) {
  const u32 chances = vertex_pair(path, kChancePair) - kVertexPairs;  // of the vertex left
  return survives(path.throughput, path.radiance_scale, path.edges > c.settings.roulette_depth,
                  [&] { return c.sampler.get2(chances).y; });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
