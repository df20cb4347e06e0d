// What one sample of a pixel brings home, plane by plane. Filled by path.h.
#pragma once

#include "kernels/bsdf/bsdf.h"
#include "kernels/scene/film.h"

namespace heliograph::kernels::inline HELIO_ISA {

inline constexpr u32 kLightPlanes = 12;
static_assert(u32(Plane::ENVIRONMENT_LIGHT) - u32(Plane::DIRECT_DIFFUSE) == kLightPlanes - 1);
inline constexpr PlaneSet kLightPlaneSet = ((PlaneSet(1) << kLightPlanes) - 1)
                                           << u32(Plane::DIRECT_DIFFUSE);
inline constexpr PlaneSet kGuidePlaneSet =
    PlaneSet(1) << u32(Plane::ALBEDO_MEAN) | PlaneSet(1) << u32(Plane::NORMAL_MEAN);

/// Those that plain programs do not make.
inline constexpr PlaneSet kRarePlaneSet =
    kLightPlaneSet | plane_bit(Plane::AMBIENT_OCCLUSION) | plane_bit(Plane::BEAUTY_GROUP);
/// Whether some of these, which are rare, are wanted.
KERNEL bool wants_rare(const FilmView& film, PlaneSet planes) {
  return kRich && (film.wanted & planes) != 0;
}

/// What a path's first vertex does with light.
enum class FirstVertex : u8 { kReflects, kTransmits, kWalksInside, kInVolume };

/// Which planes a path's light belongs to: decided where it scatters first.
struct Route {
  vec3 diffuse_share;  // of what is reflected there; the rest is glossy
  FirstVertex vertex;
};

struct SampleHead {
  vec3 radiance{0};
  float alpha = 0;
  bool hit = false;  // the camera ray met something
  float open = 1;    // of the hemisphere, for ambient occlusion
  vec2 caught{0};    // light on a shadow catcher, with and without other entities
  u32 rays = 0;
  vec3 albedo{0};  // guides
  vec3 normal{0};
};
struct SampleValues : SampleHead {
  KERNEL SampleValues() {}   // without it nvcc 13 prints "Invalid bitcast"
  vec3 light[kLightPlanes];  // in the order of the planes; set only when wanted
};

/// Adds light to a sample that left the camera directly (`seen`) or by `route`.
struct Contribution {
  vec3 radiance;
  u32 edges;  // of the path from the camera to the light, 1: seen directly
  bool environment;
  u32 group;  // light group
};
HELIO_CALL KERNEL void add_light(SampleValues& sample, const Contribution& c, const Route& route) {
  const u32 direct = c.edges == 2 ? 0 : 1;
  const u32 first = u32(Plane::DIRECT_DIFFUSE);
  if (c.edges == 1) {
    const Plane plane = c.environment ? Plane::ENVIRONMENT_LIGHT : Plane::EMISSION_LIGHT;
    sample.light[u32(plane) - first] += c.radiance;
  } else if (route.vertex == FirstVertex::kTransmits) {
    sample.light[u32(Plane::DIRECT_TRANSMISSION) - first + direct] += c.radiance;
  } else if (route.vertex == FirstVertex::kWalksInside) {
    sample.light[u32(Plane::DIRECT_SUBSURFACE) - first + direct] += c.radiance;
  } else if (route.vertex == FirstVertex::kInVolume) {
    sample.light[u32(Plane::DIRECT_VOLUME) - first + direct] += c.radiance;
  } else {
    const vec3 diffuse = c.radiance * route.diffuse_share;
    sample.light[u32(Plane::DIRECT_DIFFUSE) - first + direct] += diffuse;
    sample.light[u32(Plane::DIRECT_GLOSSY) - first + direct] += c.radiance - diffuse;
  }
}

/// Writes a sample to the film. whole: it is the last one of its block.
KERNEL void write_sample(const FilmView& film, u64 pixel, const SampleValues& s, bool whole) {
  const float beauty[4] = {s.radiance.x, s.radiance.y, s.radiance.z, s.alpha};
  if (wants(film, Plane::BEAUTY)) add_sample<4>(film, Plane::BEAUTY, pixel, beauty, whole);
  if (film.moment) {
    const float y = luminance(s.radiance);
    add_to_sum(film.moment[pixel], film.moment_partial[pixel], y * y, whole);
  }
  if (whole && wants(film, Plane::BEAUTY_GROUP)) end_group_block(film, pixel);
  if (film.catcher) {
    for (u64 i = 0; i < 2; ++i) {
      const u64 at = pixel * 2 + i;
      add_to_sum(film.catcher[at], film.catcher_partial[at], s.caught[int(i)], whole);
    }
  }
  constexpr PlaneSet kScalars =
      plane_bit(Plane::COVERAGE) | plane_bit(Plane::AMBIENT_OCCLUSION) | plane_bit(Plane::COST);
  if ((film.wanted & (kGuidePlaneSet | kLightPlaneSet | kScalars)) == 0) return;
  const auto add = [&](Plane plane, float value) {
    if (wants(film, plane)) add_sample<1>(film, plane, pixel, &value, whole);
  };
  const auto add3 = [&](Plane plane, vec3 value) {
    if (wants(film, plane)) add_sample<3>(film, plane, pixel, &value.x, whole);
  };
  add(Plane::COVERAGE, s.hit ? 1 : 0);
  add(Plane::AMBIENT_OCCLUSION, s.open);
  add(Plane::COST, float(s.rays));
  add3(Plane::ALBEDO_MEAN, s.albedo);
  add3(Plane::NORMAL_MEAN, s.normal);
  if ((film.wanted & kLightPlaneSet) == 0) return;
  for (u32 i = 0; i < kLightPlanes; ++i) {
    add3(Plane(u32(Plane::DIRECT_DIFFUSE) + i), s.light[i]);
  }
}

}  // namespace heliograph::kernels::inline HELIO_ISA
