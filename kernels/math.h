// Small mathematics every kernel uses: colours, transforms, frames, trigonometry.
#pragma once

#include "kernels/platform.h"

namespace heliograph::kernels::inline HELIO_ISA {

KERNEL float sqr(float x) { return x * x; }
KERNEL float safe_sqrt(float x) { return x > 0 ? std::sqrt(x) : 0; }
template <class T>
KERNEL T min2(T a, T b) {
  return a < b ? a : b;
}
template <class T>
KERNEL T max2(T a, T b) {
  return a > b ? a : b;
}
/// 0 for what is no number.
KERNEL float clamp01(float x) { return min2(max2(x, 0.0f), 1.0f); }
/// From a number uniform in [0, length) to one uniform in [0, 1).
KERNEL float stretched(float u, float length) { return min2(max2(u / length, 0.0f), 1 - 0x1p-24f); }
/// Of a word that is not 0.
KERNEL u32 lowest_bit(u32 bits) {
#if defined(__CUDA_ARCH__)
  return u32(__ffs(i32(bits))) - 1;
#else
  return u32(__builtin_ctz(bits));
#endif
}
KERNEL float max_component(vec3 v) { return max2(v.x, max2(v.y, v.z)); }
KERNEL float min_component(vec3 v) { return min2(v.x, min2(v.y, v.z)); }
KERNEL bool is_black(vec3 v) { return v.x == 0 && v.y == 0 && v.z == 0; }
KERNEL vec3 abs3(vec3 v) { return vec3(std::fabs(v.x), std::fabs(v.y), std::fabs(v.z)); }
KERNEL vec3 max3(vec3 a, vec3 b) { return vec3(max2(a.x, b.x), max2(a.y, b.y), max2(a.z, b.z)); }

/// Rec.709 luminance of a linear colour.
KERNEL float luminance(vec3 c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }

KERNEL vec3 transform_vector(const mat4x3& m, vec3 v) {
  return m[0] * v.x + m[1] * v.y + m[2] * v.z;
}
KERNEL vec3 transform_point(const mat4x3& m, vec3 p) { return transform_vector(m, p) + m[3]; }
/// Takes a normal along the inverse of `inverse`; the result is not unit.
KERNEL vec3 transform_normal(const mat4x3& inverse, vec3 n) {
  return vec3(dot(inverse[0], n), dot(inverse[1], n), dot(inverse[2], n));
}

/// Unit vector along v, or `otherwise` when v has no direction.
KERNEL vec3 normalize_or(vec3 v, vec3 otherwise) {
  const float length2 = dot(v, v);
  return length2 > 0 ? v * (1 / std::sqrt(length2)) : otherwise;
}

/// An orthonormal, right-handed basis; local z is n.
struct Frame {
  vec3 s, t, n;
};
KERNEL vec3 to_local(const Frame& f, vec3 v) { return vec3(dot(f.s, v), dot(f.t, v), dot(f.n, v)); }
KERNEL vec3 to_world(const Frame& f, vec3 v) { return f.s * v.x + f.t * v.y + f.n * v.z; }

/// A basis about the unit vector n.
///
/// Source: Duff et al. 2017, "Building an Orthonormal Basis, Revisited", JCGT 6(1).
KERNEL Frame make_frame(vec3 n) {
  const float sign = std::copysign(1.0f, n.z);
  const float a = -1 / (sign + n.z);
  const float b = n.x * n.y * a;
  return {vec3(1 + sign * n.x * n.x * a, sign * b, -sign * n.x),
          vec3(b, sign + n.y * n.y * a, -n.y), n};
}

struct SinCos {
  float sin, cos;
};

/// Sine and cosine of 2 pi `turns`, |turns| < 2^20; errors below 2e-7. The same bits on every
/// machine, unlike a library's.
KERNEL SinCos sincos_turns(float turns) {
  const float quadrant = std::floor(4 * turns + 0.5f);
  const float x = (4 * turns - quadrant) * (0.5f * kPi);
  const float x2 = x * x;
  const float s =
      x * (1 + x2 * (-1 / 6.0f + x2 * (1 / 120.0f + x2 * (-1 / 5040.0f + x2 / 362880))));
  const float c = 1 + x2 * (-0.5f + x2 * (1 / 24.0f + x2 * (-1 / 720.0f + x2 / 40320)));
  const i32 q = i32(quadrant);
  const float sine = q & 1 ? c : s;
  const float cosine = q & 1 ? s : c;
  return {q & 2 ? -sine : sine, (q + 1) & 2 ? -cosine : cosine};
}

/// atan2(y, x) / 2 pi, in [-0.5, 0.5]; errors below 1e-7 turns.
KERNEL float atan2_turns(float y, float x) {
  const float ax = std::fabs(x);
  const float ay = std::fabs(y);
  const float large = max2(max2(ax, ay), 0x1p-126f);
  // The angle is halved once: tan in [0, tan(pi / 8)], where a minimax polynomial is short.
  const float a = min2(ax, ay) / large;
  const float h = a / (1 + std::sqrt(1 + a * a));
  const float z = h * h;
  const float p =
      h * (1 + z * (-0.33332756f + z * (0.19971879f + z * (-0.13824454f + z * 0.07902599f))));
  float turns = p * (1 / kPi);
  if (ay > ax) turns = 0.25f - turns;
  if (x < 0) turns = 0.5f - turns;
  return y < 0 ? -turns : turns;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
