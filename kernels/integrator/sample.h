// One sample of a pixel, and its sums in the planes of a film. Filled by path.h.
#pragma once

#include "kernels/bsdf/bsdf.h"
#include "kernels/scene/film.h"

namespace heliograph::kernels::inline HELIO_ISA {

inline constexpr u32 kFirstLightPlane = u32(Plane::DIRECT_DIFFUSE);
static_assert(u32(Plane::ENVIRONMENT_LIGHT) - kFirstLightPlane == kLightPlanes - 1);
inline constexpr PlaneSet kLightPlaneSet = ((PlaneSet(1) << kLightPlanes) - 1) << kFirstLightPlane;
inline constexpr PlaneSet kGuidePlaneSet =
    plane_bit(Plane::ALBEDO_MEAN) | plane_bit(Plane::NORMAL_MEAN);

/// Planes that plain programs do not make.
inline constexpr PlaneSet kRichPlaneSet = planes_from<SampleRich>() | planes_from<GroupSums>();
/// True where a program makes rich planes and some of `planes` are wanted.
KERNEL bool wants_rich(const FilmView& film, PlaneSet planes) {
  return kRich && (film.wanted & planes) != 0;
}

/// Kinds of scattering at a path's first vertex.
enum class FirstVertex : u8 { kReflects, kTransmits, kWalksInside, kInVolume };

/// Planes that a path's light belongs to: decided where it scatters first.
struct Route {
  vec3 diffuse_share;  // of what is reflected there; the rest is glossy
  FirstVertex vertex;
};

/// SampleRich is set by begin_sample(), only when it is wanted.
struct SampleValues : SamplePlain, SampleRich {
  KERNEL SampleValues() {}  // without it nvcc 13 prints "Invalid bitcast"
};

/// Adds light to a sample that left the camera directly (`seen`) or by `route`.
struct Contribution {
  vec3 radiance;
  u32 edges;  // of the path from the camera to the light, 1: seen directly
  bool environment;
  u32 group;  // light group
};
HELIO_GPU_NOINLINE KERNEL void add_light(SampleValues& sample, const Contribution& c,
                                         const Route& route) {
  const u32 direct = c.edges == 2 ? 0 : 1;
  constexpr u32 first = kFirstLightPlane;
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

template <int N, class Value>
KERNEL void add_value(const FilmView& film, Plane plane, u64 pixel, const Value& value,
                      bool whole) {
  float channels[N];
  put_value<N>(channels, 0, value);
  add_sample<N>(film, plane, pixel, channels, whole);
}

/// Adds one part of a sample to the planes that are read from it.
template <class Part>
KERNEL void add_part(const FilmView& film, u64 pixel, const Part& from, bool whole){
#define HELIO_ADD(NAME, type, channels, fold, unit, part, value)                               \
  if constexpr (std::is_same_v<Part, part>) {                                                  \
    if (wants(film, Plane::NAME)) add_value<channels>(film, Plane::NAME, pixel, value, whole); \
  }
    HELIO_PLANES(HELIO_ADD)
#undef HELIO_ADD
}

/// Writes a sample to the film. whole: it is the last one of its block.
KERNEL void write_sample(const FilmView& film, u64 pixel, const SampleValues& s, bool whole) {
  add_part<SamplePlain>(film, pixel, s, whole);
  if (wants_rich(film, planes_from<SampleRich>())) add_part<SampleRich>(film, pixel, s, whole);
  if (film.moments) add_moments(film, pixel, luminance(s.radiance), whole);
  if (whole && wants(film, Plane::BEAUTY_GROUP)) end_group_block(film, pixel);
  if (film.catcher) {
    for (u64 i = 0; i < 2; ++i) {
      const u64 at = pixel * 2 + i;
      add_to_sum(film.catcher[at], film.catcher_partial[at], s.caught[int(i)], whole);
    }
  }
}

}  // namespace heliograph::kernels::inline HELIO_ISA
