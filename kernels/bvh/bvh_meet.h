// Where a ray meets the children of a node and a triangle. Called by bvh_tracer.h.
#pragma once

#ifdef __AVX2__
#include <immintrin.h>
#endif

#include <cstring>

#include "kernels/bvh/bvh.h"
#include "kernels/core/math.h"

namespace heliograph::kernels::inline HELIO_ISA {

struct alignas(16) Words4 {
  u32 x, y, z, w;
};

/// 16 aligned bytes that nobody writes.
KERNEL Words4 load_words(const void* at) {
#if defined(__CUDA_ARCH__)
  const uint4 words = __ldg(static_cast<const uint4*>(at));
  return {words.x, words.y, words.z, words.w};
#else
  Words4 words;
  std::memcpy(&words, __builtin_assume_aligned(at, 16), sizeof(words));
  return words;
#endif
}

KERNEL float float_of_bits(u32 bits) {
#if defined(__CUDA_ARCH__)
  return __uint_as_float(bits);
#else
  float value;
  std::memcpy(&value, &bits, sizeof(value));
  return value;
#endif
}
KERNEL u32 bits_of_float(float value) {
#if defined(__CUDA_ARCH__)
  return __float_as_uint(value);
#else
  u32 bits;
  std::memcpy(&bits, &value, sizeof(bits));
  return bits;
#endif
}
KERNEL vec3 vec3_of_bits(const Words4& w) {
  return {float_of_bits(w.x), float_of_bits(w.y), float_of_bits(w.z)};
}

KERNEL u32 count_bits(u32 bits) {
#if defined(__CUDA_ARCH__)
  return u32(__popc(i32(bits)));
#else
  return u32(__builtin_popcount(bits));
#endif
}
/// Number of the highest bit that is set, of a word that is not 0.
KERNEL u32 highest_bit(u32 bits) {
#if defined(__CUDA_ARCH__)
  return 31 - u32(__clz(i32(bits)));
#else
  return 31 - u32(__builtin_clz(bits));
#endif
}

/// A NaN among the two is dropped where it comes first.
KERNEL float min_drop_first_nan(float a, float b) {
#if defined(__CUDA_ARCH__)
  return fminf(a, b);
#else
  return a < b ? a : b;
#endif
}
KERNEL float max_drop_first_nan(float a, float b) {
#if defined(__CUDA_ARCH__)
  return fmaxf(a, b);
#else
  return a > b ? a : b;
#endif
}

/// a * b + c, on a GPU rounded once. For boxes, whose margins allow for either: what rays meet must
/// not depend on which products and sums a compiler joins.
KERNEL float mul_add(float a, float b, float c) {
#if defined(__CUDA_ARCH__)
  return __fmaf_rn(a, b, c);
#else
  return a * b + c;
#endif
}

/// A ray as boxes are met: where it starts and how far it goes by unit of each axis.
struct BoxRay {
  vec3 origin;
  vec3 inverse;  // of the direction; of one that has nearly no part along an axis, a large number
  u32 octant;    // bit 4: it goes up along x, bit 2: y, bit 1: z
};
KERNEL float inverse_component(float d) {
  constexpr float kLeast = 0x1p-80f;
  const float large_enough = std::fabs(d) < kLeast ? std::copysign(kLeast, d) : d;
#if defined(__CUDA_ARCH__)
  return __fdividef(1, large_enough);  // to a unit in the last place
#else
  return 1 / large_enough;
#endif
}
KERNEL BoxRay box_ray(vec3 origin, vec3 direction) {
  const vec3 inverse(inverse_component(direction.x), inverse_component(direction.y),
                     inverse_component(direction.z));
  return {origin, inverse,
          (inverse.x > 0 ? 4u : 0u) | (inverse.y > 0 ? 2u : 0u) | (inverse.z > 0 ? 1u : 0u)};
}

/// Some nodes or items: those of `bits` after `base`.
///
/// Nodes have bits 24 to 31, the nearest first from the highest, and in the lower 8 bits their
/// parent's BvhNode::inner. Items have bits 0 to 23.
struct alignas(8) BvhGroup {
  u32 base;
  u32 bits;
};
inline constexpr u32 kItemBits = 0xffffff;
KERNEL bool has_nodes(const BvhGroup& group) { return group.bits > kItemBits; }

/// Takes the nearest node out of a group that has nodes. Returns its number.
KERNEL u32 take_node(BvhGroup& nodes, u32 octant) {
  const u32 bit = highest_bit(nodes.bits);
  const u32 slot = (bit - 24) ^ octant;
  const u32 number = nodes.base + count_bits(nodes.bits & ((1u << slot) - 1));
  nodes.bits &= ~(1u << bit);
  return number;
}

/// Rounding of planes moves their distances by less.
/// Source: Ize 2013, "Robust BVH Ray Traversal", JCGT 2(2).
inline constexpr float kBeyond = 1 + 0x1p-21f;

// In this float the second lowest byte counts ones: a byte in its place is converted in one
// operation.
inline constexpr float kOfByte = 0x1p15f;
inline constexpr u32 kOfByteBits = 0x47000000;

/// kOfByte + byte i of a word.
///
/// bits   kOfByteBits
KERNEL float of_byte(u32 word, u32 i, u32 bits) {
#if defined(__CUDA_ARCH__)
  return __uint_as_float(__byte_perm(word, bits, 0x7604 | i << 4));
#else
  return float_of_bits(bits | (word >> 8 * i & 0xff) << 8);
#endif
}

KERNEL u32 byte_of(u32 word, u32 i) {
#if defined(__CUDA_ARCH__)
  return __byte_perm(word, 0, 0x4440 | i);
#else
  return word >> 8 * i & 0xff;
#endif
}

/// bits, shifted by the lowest 5 bits of `by`.
KERNEL u32 shifted(u32 bits, u32 by) {
#if defined(__CUDA_ARCH__)
  return __funnelshift_l(0, bits, by);
#else
  return bits << (by & 31);
#endif
}

/// Distances of planes along each axis: of_byte() * scale + offset.
struct Planes {
  vec3 scale, offset;
};

/// Boxes of 4 children, a byte each, by axis; planes in the order in which the ray meets them.
struct FourBoxes {
  u32 near[3], far[3];
  u32 meta;
};

/// A bit for each item and each node of 4 children that the ray meets before t_max.
///
/// far, t_max   beyond by kBeyond
KERNEL u32 meet_four(const FourBoxes& boxes, u32 octant, const Planes& near, const Planes& far,
                     float t_max) {
  const u32 inner = (boxes.meta & (boxes.meta << 1)) & 0x10101010u;
  const u32 shifts = boxes.meta ^ ((inner >> 4) * octant);
  const u32 bits = (boxes.meta >> 5) & 0x07070707u;
  // The sign of t_max is 0, which no compiler knows: it would load a constant again for each byte.
  const u32 of_bits = kOfByteBits | bits_of_float(t_max) >> 31;
  u32 met = 0;
  HELIO_UNROLL
  for (u32 i = 0; i < 4; ++i) {
    float begin = 0, end = t_max;
    HELIO_UNROLL
    for (int k = 0; k < 3; ++k) {
      const float low = of_byte(boxes.near[k], i, of_bits);
      const float high = of_byte(boxes.far[k], i, of_bits);
      begin = max_drop_first_nan(mul_add(low, near.scale[k], near.offset[k]), begin);
      end = min_drop_first_nan(mul_add(high, far.scale[k], far.offset[k]), end);
    }
    if (begin <= end) met |= shifted(byte_of(bits, i), shifts >> 8 * i);
  }
  return met;
}

/// Planes of a node's children as of_byte() has them, a little nearer and a little farther than
/// they are: three roundings of kOfByte * scale lose less than a 128th of the step between two
/// planes.
KERNEL void set_planes(vec3 scale, vec3 offset, Planes& near, Planes& far) {
  constexpr float kMargin = 0x1p-7f;
  for (int k = 0; k < 3; ++k) {
    const float margin = std::copysign(kMargin, scale[k]);
    near.scale[k] = scale[k];
    near.offset[k] = mul_add(-(kOfByte + margin), scale[k], offset[k]);
    far.scale[k] = scale[k] * kBeyond;
    far.offset[k] = mul_add(-(kOfByte - margin), far.scale[k], offset[k] * kBeyond);
  }
}

struct NodeChildren {
  BvhGroup nodes, items;
};

#if defined(__AVX2__) && !defined(__CUDA_ARCH__)

/// 8 bytes.
KERNEL __m256 load_bytes(const u8* bytes) {
  return _mm256_cvtepi32_ps(
      _mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(bytes))));
}

/// A bit for each item and each node of 8 children that the ray meets before t_max: meet_four() of
/// both halves, but for its margins.
KERNEL u32 meet_eight(const BvhNode& node, const BoxRay& ray, float t_max) {
  __m256 near = _mm256_setzero_ps(), far = _mm256_set1_ps(t_max);
  for (int k = 0; k < 3; ++k) {
    const bool up = (ray.octant >> (2 - k) & 1) != 0;
    const __m256 scale =
        _mm256_set1_ps(ray.inverse[k] * float_of_bits(u32(node.exponent[k]) << 23));
    const __m256 offset = _mm256_set1_ps((node.origin[k] - ray.origin[k]) * ray.inverse[k]);
    const __m256 low = load_bytes(node.low[k]), high = load_bytes(node.high[k]);
    near = _mm256_max_ps(_mm256_add_ps(_mm256_mul_ps(up ? low : high, scale), offset), near);
    far = _mm256_min_ps(_mm256_add_ps(_mm256_mul_ps(up ? high : low, scale), offset), far);
  }
  far = _mm256_mul_ps(far, _mm256_set1_ps(kBeyond));
  u32 met = 0;
  for (u32 met_slots = u32(_mm256_movemask_ps(_mm256_cmp_ps(near, far, _CMP_LE_OQ))); met_slots;
       met_slots &= met_slots - 1) {
    const u32 meta = node.meta[__builtin_ctz(met_slots)];
    const u32 inner = meta & (meta << 1) & 0x10;
    met |= (meta >> 5) << ((meta ^ ((inner >> 4) * ray.octant)) & 0x1f);
  }
  return met;
}

#endif

/// The children of a node that a ray meets before t_max.
KERNEL NodeChildren meet_children(const BvhNode* node, const BoxRay& ray, float t_max) {
#if defined(__AVX2__) && !defined(__CUDA_ARCH__)
  const u32 met = meet_eight(*node, ray, t_max);
  return {{node->first_child, (met & ~kItemBits) | node->inner},
          {node->first_item, met & kItemBits}};
#else
  const auto* words = reinterpret_cast<const Words4*>(node);
  const Words4 n0 = load_words(words), n1 = load_words(words + 1), n2 = load_words(words + 2);
  const Words4 n3 = load_words(words + 3), n4 = load_words(words + 4);
  const vec3 scale = ray.inverse * vec3(float_of_bits((n0.w & 0xff) << 23),
                                        float_of_bits((n0.w >> 8 & 0xff) << 23),
                                        float_of_bits((n0.w >> 16 & 0xff) << 23));
  const vec3 offset = (vec3_of_bits(n0) - ray.origin) * ray.inverse;
  const u32 low[2][3] = {{n2.x, n2.z, n3.x}, {n2.y, n2.w, n3.y}};
  const u32 high[2][3] = {{n3.z, n4.x, n4.z}, {n3.w, n4.y, n4.w}};
  const u32 meta[2] = {n1.z, n1.w};
  Planes near, far;
  set_planes(scale, offset, near, far);
  u32 met = 0;
  HELIO_UNROLL
  for (int half = 0; half < 2; ++half) {
    FourBoxes boxes;
    boxes.meta = meta[half];
    HELIO_UNROLL
    for (int k = 0; k < 3; ++k) {
      const bool up = (ray.octant >> (2 - k) & 1) != 0;
      boxes.near[k] = up ? low[half][k] : high[half][k];
      boxes.far[k] = up ? high[half][k] : low[half][k];
    }
    met |= meet_four(boxes, ray.octant, near, far, t_max * kBeyond);
  }
  return {{n1.x, (met & ~kItemBits) | n0.w >> 24}, {n1.y, met & kItemBits}};
#endif
}

/// Where a ray meets a triangle; u, v: weights of vertices 1 and 2.
struct TriangleHit {
  float t;
  float u, v;
};

/// a * b, never joined with a sum that follows.
KERNEL float product(float a, float b) {
#if defined(__CUDA_ARCH__)
  return __fmul_rn(a, b);
#else
  return a * b;
#endif
}

/// A plane across a ray: what lies along the ray is one point of it.
struct Across {
  vec3 x, y;
};
/// d, inverse   the ray's direction, as in BoxRay
KERNEL Across across(vec3 d, vec3 inverse) {
  const vec3 size = abs3(d);
  if (size.z >= size.x && size.z >= size.y)
    return {vec3(1, 0, -d.x * inverse.z), vec3(0, 1, -d.y * inverse.z)};
  if (size.y >= size.x) return {vec3(1, -d.x * inverse.y, 0), vec3(0, -d.z * inverse.y, 1)};
  return {vec3(-d.y * inverse.x, 1, 0), vec3(-d.z * inverse.x, 0, 1)};
}
KERNEL vec2 place(const Across& across, vec3 p) {
  return {mul_add(across.x.z, p.z, mul_add(across.x.y, p.y, across.x.x * p.x)),
          mul_add(across.y.z, p.z, mul_add(across.y.y, p.y, across.y.x * p.x))};
}
/// On which side of an edge across a ray the ray passes: its sign. Rounding makes it 0, never the
/// other one, and the edge from b to a has the other sign.
KERNEL float side(vec2 a, vec2 b) { return product(a.x, b.y) - product(a.y, b.x); }

/// True if a ray meets a triangle, from either side, at t in (0, t_max]. No ray passes between
/// triangles that share vertices: each vertex has one place across the ray, and an edge that the
/// ray is on belongs to both triangles.
///
/// across   the ray's
/// Source: Woop, Benthin and Wald 2013, "Watertight Ray/Triangle Intersection", JCGT 2(1), without
/// its double precision: what that decides, both triangles take here.
KERNEL bool meet_triangle(const BvhTriangle& triangle, vec3 origin, vec3 direction,
                          const Across& across, float t_max, TriangleHit& hit) {
  const vec3 to_a = triangle.a - origin;
  const vec2 a = place(across, to_a);
  const vec2 b = place(across, triangle.b - origin), c = place(across, triangle.c - origin);
  const float of_a = side(b, c), of_b = side(c, a), of_c = side(a, b);
  if (min_drop_first_nan(min_drop_first_nan(of_a, of_b), of_c) < 0 &&
      max_drop_first_nan(max_drop_first_nan(of_a, of_b), of_c) > 0)
    return false;
  const vec3 normal = cross(triangle.b - triangle.a, triangle.c - triangle.a);
  const float t = dot(normal, to_a) / dot(normal, direction), all = of_a + of_b + of_c;
  if (!(t > 0 && t <= t_max && all != 0)) return false;  // equals are equal whichever comes first
  hit = {t, of_b / all, of_c / all};
  return true;
}

/// Item i of a tree that has triangles.
KERNEL BvhTriangle load_triangle(const BvhTriangle* triangles, u32 i) {
  const auto* words = reinterpret_cast<const Words4*>(triangles + i);
  const Words4 a = load_words(words), b = load_words(words + 1), c = load_words(words + 2);
  return {vec3_of_bits(a), a.w, vec3_of_bits(b), b.w, vec3_of_bits(c), c.w};
}

}  // namespace heliograph::kernels::inline HELIO_ISA
