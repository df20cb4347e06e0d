// Small mathematics every kernel uses: colours, transforms, frames, trigonometry.
#pragma once

#include "kernels/core/platform.h"

namespace heliograph::kernels::inline HELIO_ISA {

// Templates over F take floats, or several side by side (lanes.h).
template <class F>
using Vec2 = glm::vec<2, F>;
template <class F>
using Vec3 = glm::vec<3, F>;
template <class F>
using Mat4x3 = glm::mat<4, 3, F>;

/// Types of integers, truth values and enumerations where numbers are F.
template <class F>
struct InLanes {
  using Int = i32;
  using Index = u32;
  using Bool = bool;
  template <class E>
  using Enum = E;
};
template <class F>
using IntOf = typename InLanes<F>::Int;
template <class F>
using IndexOf = typename InLanes<F>::Index;
template <class F>
using BoolOf = typename InLanes<F>::Bool;
template <class F, class E>
using EnumOf = typename InLanes<F>::template Enum<E>;

template <class T>
KERNEL T min2(T a, T b) {
  return a < b ? a : b;
}
template <class T>
KERNEL T max2(T a, T b) {
  return a > b ? a : b;
}

/// Truth of several numbers side by side.
template <class M>
concept LaneMask = std::is_class_v<M>;

KERNEL bool any(bool b) { return b; }
KERNEL bool all(bool b) { return b; }
/// i where the condition is true, which it is somewhere; elsewhere one of those.
KERNEL u32 fill(bool, u32 i) { return i; }
template <class T>
KERNEL T select(bool condition, T a, T b) {
  return condition ? a : b;
}
/// f() where the condition holds and g() elsewhere; neither is called for nobody.
template <class F, class G>
KERNEL auto either(bool condition, const F& f, const G& g) {
  return condition ? f() : g();
}
KERNEL float sqrt(float x) { return std::sqrt(x); }
KERNEL float exp(float x) { return std::exp(x); }
KERNEL float pow(float x, float y) { return std::pow(x, y); }
KERNEL float copysign(float x, float sign) { return std::copysign(x, sign); }
KERNEL float floor(float x) { return std::floor(x); }
KERNEL float abs(float x) { return std::fabs(x); }
/// 1 or -1, by the sign bit.
KERNEL float sign_of(float x) { return std::copysign(1.0f, x); }
KERNEL i32 to_int(float x) { return i32(x); }
KERNEL float to_float(i32 x) { return float(x); }
KERNEL float gather(const float* table, i32 i) { return table[i]; }
KERNEL float gather(const float* table, u32 i) { return table[i]; }
KERNEL u32 gather(const u16* table, u32 i) { return table[i]; }
/// Four numbers that lie one after the other.
template <class F>
struct FourOf {
  F of[4];
};
KERNEL FourOf<float> gather4(const float* table, i32 i) {
  return {{table[i], table[i + 1], table[i + 2], table[i + 3]}};
}

template <class F>
KERNEL F sqr(F x) {
  return x * x;
}
template <class F>
KERNEL F safe_sqrt(F x) {
  return sqrt(max2(x, F(0)));
}
/// 0 for what is no number.
template <class F>
KERNEL F clamp01(F x) {
  return min2(max2(x, F(0)), F(1));
}
/// From a number uniform in [0, length) to one uniform in [0, 1).
template <class F>
KERNEL F rescale_uniform(F u, F length) {
  return min2(max2(u / length, F(0)), F(1 - 0x1p-24f));
}
/// Number of the lowest bit that is set, of a word that is not 0.
KERNEL u32 lowest_bit(u64 bits) {
#if defined(__CUDA_ARCH__)
  return u32(__ffsll(static_cast<long long>(bits))) - 1;
#else
  return u32(__builtin_ctzll(bits));
#endif
}
template <class F>
KERNEL F max_component(Vec3<F> v) {
  return max2(v.x, max2(v.y, v.z));
}
template <class F>
KERNEL F min_component(Vec3<F> v) {
  return min2(v.x, min2(v.y, v.z));
}
template <class F>
KERNEL BoolOf<F> is_black(Vec3<F> v) {
  return (v.x == 0) & (v.y == 0) & (v.z == 0);
}
template <class F>
KERNEL Vec3<F> abs3(Vec3<F> v) {
  return Vec3<F>(abs(v.x), abs(v.y), abs(v.z));
}
/// By component, as GLM's.
template <class F>
KERNEL Vec3<F> min3(Vec3<F> a, Vec3<F> b) {
  return Vec3<F>(min2(b.x, a.x), min2(b.y, a.y), min2(b.z, a.z));
}
template <class F>
KERNEL Vec3<F> max3(Vec3<F> a, Vec3<F> b) {
  return Vec3<F>(max2(b.x, a.x), max2(b.y, a.y), max2(b.z, a.z));
}
template <class F>
KERNEL Vec3<F> sqrt3(Vec3<F> v) {
  return Vec3<F>(sqrt(v.x), sqrt(v.y), sqrt(v.z));
}

/// Rec.709 luminance of a linear colour.
template <class F>
KERNEL F luminance(Vec3<F> c) {
  return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z;
}

template <class M, class F>
KERNEL Vec3<F> transform_vector(const Mat4x3<M>& m, Vec3<F> v) {
  return Vec3<F>(m[0].x * v.x + m[1].x * v.y + m[2].x * v.z,
                 m[0].y * v.x + m[1].y * v.y + m[2].y * v.z,
                 m[0].z * v.x + m[1].z * v.y + m[2].z * v.z);
}
template <class F>
KERNEL Vec3<F> transform_point(const Mat4x3<F>& m, Vec3<F> p) {
  return transform_vector(m, p) + m[3];
}
/// Takes a normal along the inverse of `inverse`; the result is not unit.
template <class F>
KERNEL Vec3<F> transform_normal(const Mat4x3<F>& inverse, Vec3<F> n) {
  return Vec3<F>(dot(inverse[0], n), dot(inverse[1], n), dot(inverse[2], n));
}

/// Unit vector along v, or `otherwise` when v has no direction. Lengths from 1e-18 to 1e18; see
/// near_one().
template <class F>
KERNEL Vec3<F> normalize_or(Vec3<F> v, Vec3<F> otherwise) {
  const F length2 = dot(v, v);
  return select(length2 > 0, v * (1 / sqrt(length2)), otherwise);
}

/// A power of two that brings a number in [2^-126, 2^127) into [1, 2).
KERNEL float scale_near_one(float x) {
  return __builtin_bit_cast(float, 0x7f000000u - (__builtin_bit_cast(u32, x) & 0x7f800000u));
}
/// v times a power of two that brings its largest component into [1, 2): the same direction to the
/// last bit. Of a component in [2^-126, 2^127).
template <class F>
KERNEL Vec3<F> near_one(Vec3<F> v) {
  return v * scale_near_one(max_component(abs3(v)));
}

/// An orthonormal, right-handed basis; local z is n.
template <class F>
struct FrameOf {
  Vec3<F> s, t, n;
};
using Frame = FrameOf<float>;
template <class F>
KERNEL Vec3<F> to_local(const FrameOf<F>& f, Vec3<F> v) {
  return Vec3<F>(dot(f.s, v), dot(f.t, v), dot(f.n, v));
}
template <class F>
KERNEL Vec3<F> to_world(const FrameOf<F>& f, Vec3<F> v) {
  return f.s * v.x + f.t * v.y + f.n * v.z;
}

/// A basis about the unit vector n.
///
/// Source: Duff et al. 2017, "Building an Orthonormal Basis, Revisited", JCGT 6(1).
template <class F>
KERNEL FrameOf<F> make_frame(Vec3<F> n) {
  const F sign = sign_of(n.z);
  const F a = -1 / (sign + n.z);
  const F b = n.x * n.y * a;
  return {Vec3<F>(1 + sign * n.x * n.x * a, sign * b, -sign * n.x),
          Vec3<F>(b, sign + n.y * n.y * a, -n.y), n};
}

template <class F>
struct SinCosOf {
  F sin, cos;
};
using SinCos = SinCosOf<float>;

/// Sine and cosine of 2 pi `turns`, |turns| < 2^20; errors below 2e-7. The same bits on every
/// machine, unlike a library's.
template <class F>
KERNEL SinCosOf<F> sincos_turns(F turns) {
  const F quadrant = floor(4 * turns + 0.5f);
  const F x = (4 * turns - quadrant) * (0.5f * kPi);
  const F x2 = x * x;
  const F s =
      x * (1 + x2 * (-1 / 6.0f + x2 * (1 / 120.0f + x2 * (-1 / 5040.0f + x2 * (1 / 362880.0f)))));
  const F c = 1 + x2 * (-0.5f + x2 * (1 / 24.0f + x2 * (-1 / 720.0f + x2 * (1 / 40320.0f))));
  const IntOf<F> q = to_int(quadrant);
  const BoolOf<F> even = (q & 1) == 0;
  const F sine = select(even, s, c);
  const F cosine = select(even, c, s);
  return {select((q & 2) == 0, sine, -sine), select(((q + 1) & 2) == 0, cosine, -cosine)};
}

/// atan2(y, x) / 2 pi, in [-0.5, 0.5]; errors below 1e-7 turns.
template <class F>
KERNEL F atan2_turns(F y, F x) {
  const F ax = abs(x);
  const F ay = abs(y);
  const F large = max2(max2(ax, ay), F(0x1p-126f));
  // The angle is halved once: tan in [0, tan(pi / 8)], where a minimax polynomial is short.
  const F a = min2(ax, ay) / large;
  const F h = a / (1 + sqrt(1 + a * a));
  const F z = h * h;
  const F p =
      h * (1 + z * (-0.33332756f + z * (0.19971879f + z * (-0.13824454f + z * 0.07902599f))));
  F turns = p * (1 / kPi);
  turns = select(ay > ax, 0.25f - turns, turns);
  turns = select(x < 0, 0.5f - turns, turns);
  return select(y < 0, -turns, turns);
}
KERNEL float atan2_turns(float y, float x) { return atan2_turns<float>(y, x); }

/// A direction in the space that a matrix leads to.
template <class F>
KERNEL Vec3<F> turned(const mat3& m, Vec3<F> d) {
  return Vec3<F>(m[0].x * d.x + m[1].x * d.y + m[2].x * d.z,
                 m[0].y * d.x + m[1].y * d.y + m[2].y * d.z,
                 m[0].z * d.x + m[1].z * d.y + m[2].z * d.z);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
