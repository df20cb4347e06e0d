// Support for one source on every target: the macro KERNEL, GLM, integer names.
#pragma once

#if defined(__CUDACC__)
#include <cuda.h>  // GLM reads CUDA_VERSION and does not include it itself
#define KERNEL __host__ __device__ inline
#else
#define KERNEL inline
#endif

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <type_traits>

// Every kernel function lives in this inline namespace, so that one binary can hold the kernels
// compiled for several instruction sets. A translation unit built for one of them defines it.
#ifndef HELIO_ISA
#define HELIO_ISA baseline
#endif

// A step that few paths take: it stays out of those that call it.
#define HELIO_RARE __attribute__((noinline))

// A step of the path's loop, which is its only caller.
#define HELIO_ALWAYS_INLINE __attribute__((always_inline))

// A piece that many steps call: on a GPU it is there once. Inlined everywhere, a program would be
// several times as long and slower.
#if defined(__CUDA_ARCH__)
#define HELIO_GPU_NOINLINE __attribute__((noinline))
#else
#define HELIO_GPU_NOINLINE
#endif

// A piece of a path's step that takes its state by reference: called, it keeps that in memory. On a
// GPU it is there once, like others; in a plain program it is a part of the step.
#if defined(HELIO_PLAIN) && defined(__CUDA_ARCH__)
#define HELIO_GPU_NOINLINE_UNLESS_PLAIN __attribute__((always_inline))
#else
#define HELIO_GPU_NOINLINE_UNLESS_PLAIN HELIO_GPU_NOINLINE
#endif

// Before a loop whose arrays a GPU keeps in registers, once each index is known.
#if defined(__CUDA_ARCH__)
#define HELIO_UNROLL _Pragma("unroll")
#else
#define HELIO_UNROLL
#endif

// A constant table that kernels index at run time.
#if defined(__CUDA_ARCH__)
#define HELIO_TABLE static __device__ const
#else
#define HELIO_TABLE inline constexpr
#endif

namespace heliograph::kernels {

using u8 = std::uint8_t;
using u16 = std::uint16_t;
using u32 = std::uint32_t;
using u64 = std::uint64_t;
using i32 = std::int32_t;

using glm::ivec2;
using glm::ivec3;
using glm::mat3;
using glm::mat4x3;
using glm::uvec2;
using glm::uvec3;
using glm::vec2;
using glm::vec3;
using glm::vec4;

/// Asks for memory that is read soon. What does nothing else is to be inlined always: g++ takes a
/// call of it for one without effects, and leaves it out.
HELIO_ALWAYS_INLINE KERNEL void prefetch(const void* at) {
#if !defined(__CUDA_ARCH__)
  __builtin_prefetch(at);
#endif
}

// Features that few scenes have, and plain programs leave out: media and volumes, light travelling
// in bodies, layers, films, stretched highlights, sheets of glass; and what few films want beside
// beauty. A path's state then fits into a GPU's registers. is_plain() names what they render.
#if defined(HELIO_PLAIN)
inline constexpr bool kRich = false;
#else
inline constexpr bool kRich = true;
#endif

// Features that few scenes have for rays to meet, and programs for plain rays leave out: motion,
// deformation, holes. SceneView::plain_rays is true for scenes whose rays they trace.
#if defined(HELIO_PLAIN_RAYS)
inline constexpr bool kRichRays = false;
#else
inline constexpr bool kRichRays = true;
#endif

/// So many numbers a CPU takes side by side.
inline constexpr u32 kLanes = 8;

inline constexpr float kPi = 3.14159265358979323846f;
inline constexpr float kInvPi = 0.31830988618379067154f;
inline constexpr u32 kNone = 0xffffffffu;

}  // namespace heliograph::kernels
