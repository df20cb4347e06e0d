// Items that wait between two steps of a wave, packed: it spends much of its time on moving them.
// Called by wave.h.
#pragma once

#include "kernels/integrator/path.h"

namespace heliograph::kernels::inline HELIO_ISA {

// A GPU's thread moves 16 bytes at a time on request only: member by member, it would ask the
// memory four times as often. What it moves is of no use to others, or later: the caches are for
// what threads share and for their stacks.
template <class T>
KERNEL T load_whole(const T& from) {
#if defined(__CUDA_ARCH__)
  struct Words {
    uint4 of[sizeof(T) / sizeof(uint4)];
  };
  static_assert(sizeof(T) == sizeof(Words) && alignof(T) == alignof(uint4));
  Words words;
  for (u32 i = 0; i < sizeof(T) / sizeof(uint4); ++i)
    words.of[i] = __ldcs(reinterpret_cast<const uint4*>(&from) + i);
  return __builtin_bit_cast(T, words);
#else
  return from;
#endif
}
template <class T>
KERNEL void store_whole(T& to, const T& value) {
#if defined(__CUDA_ARCH__)
  static_assert(sizeof(T) % sizeof(uint4) == 0 && alignof(T) == alignof(uint4));
  for (u32 i = 0; i < sizeof(T) / sizeof(uint4); ++i)
    __stcs(reinterpret_cast<uint4*>(&to) + i, reinterpret_cast<const uint4*>(&value)[i]);
#else
  to = value;
#endif
}

struct alignas(16) WaveHit {
  Hit hit;
};
struct alignas(16) WaveLight {
  Ray ray;
  vec3 radiance;
  u32 group;
  u32 edges : 31, environment : 1;
};
struct alignas(16) WaveRoute {
  vec3 diffuse_share;
  u32 vertex;
};
struct alignas(16) WaveSample {
  vec3 radiance;
  u32 rays;
};
/// Values that a sample has from the first vertices of its path.
struct alignas(16) WaveFirst {
  vec3 albedo;
  float alpha;
  vec3 normal;
  u32 hit;
  vec2 caught;
};
static_assert(sizeof(WaveLight) == 64);
static_assert(sizeof(WaveSample) == 16 && sizeof(WaveFirst) == 48);

/// Memory of a wave, by item.
struct WaveView {
  PathState* paths;
  PathRay* rays;
  WaveHit* hits;
  WaveLight* lights;
  Inside* insides;  // null where the scene has no media
  Reach* reaches;   // null where the scene has no media
  WaveSample* samples;
  WaveFirst* firsts;
  SampleRich* riches;  // null unless wanted
  WaveRoute* routes;   // (2) of each: its path's and its light's; null unless riches are
  FilmView film;       // items in the place of pixels: light groups add up there
};

}  // namespace heliograph::kernels::inline HELIO_ISA
