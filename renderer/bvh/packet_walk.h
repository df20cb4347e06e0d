// Eight rays at once through the BVH of one mesh. Included by rays_body.h, which is compiled for
// each instruction set.
#pragma once

#include <immintrin.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <initializer_list>

#include "kernels/bvh/bvh_tracer.h"
#include "renderer/host/ray_packet.h"

namespace heliograph::bvh::inline HELIO_ISA {

using kernels::u32;

/// A number for each ray, or for each child of a node.
using Floats [[gnu::vector_size(32)]] = float;
using Ints [[gnu::vector_size(32)]] = kernels::i32;

/// A bit for each lane that is true.
inline u32 bits_of(const Ints& truth) {
#ifdef __AVX__
  return u32(_mm256_movemask_ps(__m256(truth)));
#else
  __m128 half[2];
  std::memcpy(half, &truth, sizeof(half));
  return u32(_mm_movemask_ps(half[0]) | _mm_movemask_ps(half[1]) << 4);
#endif
}
inline Floats lesser(const Floats& a, const Floats& b) {
#ifdef __AVX__
  return Floats(_mm256_min_ps(__m256(a), __m256(b)));
#else
  return a < b ? a : b;
#endif
}
inline Floats greater(const Floats& a, const Floats& b) {
#ifdef __AVX__
  return Floats(_mm256_max_ps(__m256(a), __m256(b)));
#else
  return a > b ? a : b;
#endif
}
/// Eight bytes.
inline Floats floats_at(const kernels::u8* bytes) {
#ifdef __AVX2__
  return Floats(kernels::load_bytes(bytes));
#else
  const __m128i eight = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(bytes));
  const __m128 half[2]{_mm_cvtepi32_ps(_mm_cvtepu8_epi32(eight)),
                       _mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_srli_si128(eight, 4)))};
  Floats floats;
  std::memcpy(&floats, half, sizeof(floats));
  return floats;
#endif
}
inline float least_of(Floats v) {
  v = lesser(v, __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3));
  v = lesser(v, __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5));
  v = lesser(v, __builtin_shufflevector(v, v, 1, 0, 3, 2, 5, 4, 7, 6));
  return v[0];
}
inline float most_of(const Floats& v) { return -least_of(-v); }

/// kernels::inverse_component() of each.
inline Floats inverse_of(const Floats& d) {
  const Floats least = Floats{} + 0x1p-80f;
  const Ints sign = Ints(d) & INT32_MIN;
  const Floats size = Floats(Ints(d) ^ sign);
  return 1 / Floats(Ints(greater(size, least)) | sign);
}

/// Test of whether rays of object space, of directions of any length, meet a mesh. Answers for each
/// as kernels::BvhTracer::meets(), but the rays go down the tree together: children are tested
/// eight at a time against the bounds of all rays, then one by one against eight rays at a time.
///
/// Source: Wald, Boulos and Shirley 2007, "Ray Tracing Deformable Scenes Using Dynamic Bounding
/// Volume Hierarchies", ACM TOG 26(1), section 4.
class PacketWalk {
 public:
  /// True if the rays that are asked for go along the same axis more than along the others: others
  /// do not go together.
  static bool go_together(const host::RayPacket& rays, u32 lanes);
  PacketWalk(const host::RayPacket& rays, u32 lanes);

  /// Which of `lanes` meet the tree over triangles that triangle(i) gives.
  template <class F>
  [[nodiscard]] u32 meets(const kernels::BvhNode* nodes, F&& triangle) const;

 private:
  /// As kernels::across() chooses it.
  static int axis_of(const host::RayPacket& rays, u32 i);
  /// A node as each ray sees it: the distance of a plane is byte * scale + offset.
  struct Seen {
    Floats scale[3], offset[3];
  };
  [[nodiscard]] Seen seen(const kernels::BvhNode& node) const;
  /// A bit for each child that a ray may meet.
  [[nodiscard]] u32 children(const kernels::BvhNode& node) const;
  /// A bit for each ray that meets a child.
  [[nodiscard]] u32 rays_to(const kernels::BvhNode& node, u32 child, const Seen& seen) const;
  [[nodiscard]] u32 rays_to(const kernels::BvhTriangle& triangle) const;

  Floats origin_[3], direction_[3], inverse_[3];
  int axis_, axis_x_, axis_y_;  // the axis along which the rays go, and those across
  Floats shear_x_, shear_y_;
  Floats t_min_, t_max_;
  struct Bounds {
    float least, most;
  };
  Bounds origins_[3], inverses_[3];
  float least_t_, most_t_;
  u32 lanes_;
  u32 octant_;  // of the first ray, as in BoxRay
};

inline int PacketWalk::axis_of(const host::RayPacket& rays, u32 i) {
  const float x = std::fabs(rays.direction_x[i]), y = std::fabs(rays.direction_y[i]),
              z = std::fabs(rays.direction_z[i]);
  if (z >= x && z >= y) return 2;
  return y >= x ? 1 : 0;
}

inline bool PacketWalk::go_together(const host::RayPacket& rays, u32 lanes) {
  const int axis = axis_of(rays, u32(std::countr_zero(lanes)));
  for (; lanes; lanes &= lanes - 1)
    if (axis_of(rays, u32(std::countr_zero(lanes))) != axis) return false;
  return true;
}

inline PacketWalk::PacketWalk(const host::RayPacket& rays, u32 lanes) : lanes_(lanes) {
  const float* origin[]{rays.origin_x, rays.origin_y, rays.origin_z};
  const float* direction[]{rays.direction_x, rays.direction_y, rays.direction_z};
  const int first = std::countr_zero(lanes);
  // Rays that are not asked for are as the first one: they must not widen the bounds.
  const Ints asked = (Ints{1, 2, 4, 8, 16, 32, 64, 128} & Ints(Ints{} + int(lanes))) != 0;
  const auto load = [&](const float* values) {
    Floats all;
    std::memcpy(&all, values, sizeof(all));
    return asked ? all : Floats{} + values[first];
  };
  octant_ = 0;
  for (int k = 0; k < 3; ++k) {
    origin_[k] = load(origin[k]);
    direction_[k] = load(direction[k]);
    inverse_[k] = inverse_of(direction_[k]);
    origins_[k] = {least_of(origin_[k]), most_of(origin_[k])};
    inverses_[k] = {least_of(inverse_[k]), most_of(inverse_[k])};
    octant_ |= u32(inverse_[k][first] > 0) << (2 - k);
  }
  axis_ = axis_of(rays, u32(first));
  axis_x_ = axis_ == 0 ? 1 : 0;
  axis_y_ = axis_ == 2 ? 1 : 2;
  shear_x_ = -direction_[axis_x_] * inverse_[axis_];
  shear_y_ = -direction_[axis_y_] * inverse_[axis_];
  t_min_ = load(rays.t_min);
  least_t_ = least_of(t_min_);
  t_max_ = load(rays.t_max);
  most_t_ = most_of(t_max_);
}

inline float plane_scale(const kernels::BvhNode& node, int axis) {
  return kernels::float_of_bits(u32(node.exponent[axis]) << 23);
}

inline PacketWalk::Seen PacketWalk::seen(const kernels::BvhNode& node) const {
  Seen seen;
  for (int k = 0; k < 3; ++k) {
    seen.scale[k] = inverse_[k] * plane_scale(node, k);
    seen.offset[k] = (node.origin[k] - origin_[k]) * inverse_[k];
  }
  return seen;
}

inline u32 PacketWalk::children(const kernels::BvhNode& node) const {
  Floats near = Floats{} + least_t_, far = Floats{} + most_t_;
  for (int k = 0; k < 3; ++k) {
    const Bounds& inverse = inverses_[k];
    const float scale = plane_scale(node, k);
    const float a = node.origin[k] - origins_[k].most, b = node.origin[k] - origins_[k].least;
    const float aa = a * inverse.least, ab = a * inverse.most, ba = b * inverse.least,
                bb = b * inverse.most;
    const float least = kernels::min2(kernels::min2(aa, ab), kernels::min2(ba, bb));
    const float most = kernels::max2(kernels::max2(aa, ab), kernels::max2(ba, bb));
    const Floats low = floats_at(node.low[k]), high = floats_at(node.high[k]);
    const Floats l0 = low * (inverse.least * scale), h0 = high * (inverse.least * scale);
    const Floats l1 = low * (inverse.most * scale), h1 = high * (inverse.most * scale);
    near = greater(lesser(l0, h0) + least, near);
    far = lesser(greater(l1, h1) + most, far);
  }
  return bits_of(near <= far * kernels::kBeyond);
}

inline u32 PacketWalk::rays_to(const kernels::BvhNode& node, u32 child, const Seen& seen) const {
  Floats near = t_min_, far = t_max_;
  for (int k = 0; k < 3; ++k) {
    const Floats a = float(node.low[k][child]) * seen.scale[k] + seen.offset[k];
    const Floats b = float(node.high[k][child]) * seen.scale[k] + seen.offset[k];
    near = greater(lesser(a, b), near);
    far = lesser(greater(a, b), far);
  }
  return bits_of(near <= far * kernels::kBeyond);
}

/// The operations of kernels::meet_triangle() in its order, but for products with 0 and 1.
inline u32 PacketWalk::rays_to(const kernels::BvhTriangle& triangle) const {
  const kernels::vec3 corners[3]{triangle.a, triangle.b, triangle.c};
  Floats to_a[3], x[3], y[3];
  for (int i = 0; i < 3; ++i) {
    Floats p[3];
    for (int k = 0; k < 3; ++k) p[k] = corners[i][k] - origin_[k];
    x[i] = p[axis_x_] + shear_x_ * p[axis_];
    y[i] = p[axis_y_] + shear_y_ * p[axis_];
    if (i == 0) std::ranges::copy(p, to_a);
  }
  const auto side = [&](int i, int j) { return x[i] * y[j] - y[i] * x[j]; };
  const Floats a = side(1, 2), b = side(2, 0), c = side(0, 1);
  const Floats least = lesser(lesser(a, b), c), most = greater(greater(a, b), c);
  const kernels::vec3 normal = cross(triangle.b - triangle.a, triangle.c - triangle.a);
  const Floats den = normal.x * direction_[0] + normal.y * direction_[1] + normal.z * direction_[2];
  const Floats t = (normal.x * to_a[0] + normal.y * to_a[1] + normal.z * to_a[2]) / den;
  const Floats zero{};
  return bits_of(((least >= zero) | (most <= zero)) & (a + b + c != zero) & (t > t_min_) &
                 (t <= t_max_));
}

template <class F>
u32 PacketWalk::meets(const kernels::BvhNode* nodes, F&& triangle) const {
  struct Entry {
    u32 node;
    u32 rays;
  };
  Entry stack[kernels::kBvhChildren * kernels::kBvhDepth + 1];
  u32 size = 0, met = 0;
  stack[size++] = {0, lanes_};
  while (size > 0) {
    const Entry entry = stack[--size];
    u32 rays = entry.rays & ~met;
    if (rays == 0) continue;
    const kernels::BvhNode& node = nodes[entry.node];
    const u32 near = children(node);
    if (near == 0) continue;
    const Seen planes = seen(node);
    for (u32 i = 0; i < kernels::kBvhChildren; ++i) {  // the nearest last: it is taken first
      const u32 child = i ^ octant_, meta = node.meta[child];
      if (!(near >> child & 1) || meta == 0) continue;
      const u32 in = rays_to(node, child, planes) & rays;
      if (in == 0) continue;
      if (node.inner >> child & 1) {
        stack[size++] = {node.first_child + kernels::count_bits(node.inner & ((1u << child) - 1)),
                         in};
        continue;
      }
      const u32 begin = node.first_item + (meta & 31), end = begin + kernels::count_bits(meta >> 5);
      for (u32 item = begin; item < end; ++item) met |= rays_to(triangle(item)) & in;
      rays &= ~met;
    }
  }
  return met;
}

}  // namespace heliograph::bvh::inline HELIO_ISA
