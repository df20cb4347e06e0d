// Eight numbers side by side in the vectors of a CPU: what templates of the kernels take in place
// of a float. Each lane has the bits that a float would have, whatever the others hold, but where
// the compiler fuses multiplications and additions.
//
// Tested: tests/unit/lanes_test.cpp.
#pragma once

#include <limits>

#include "kernels/core/math.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

// Nothing here is called across translation units.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace heliograph::kernels::inline HELIO_ISA {

using FloatVector = float __attribute__((vector_size(4 * kLanes)));
using IntVector = i32 __attribute__((vector_size(4 * kLanes)));

/// True or false in each lane.
struct Mask {
  IntVector v;  // -1 or 0

  Mask() = default;
  Mask(IntVector vector) : v(vector) {}
  Mask(bool b) : v(IntVector{} - i32(b)) {}
  friend Mask operator&(Mask a, Mask b) { return {a.v & b.v}; }
  friend Mask operator|(Mask a, Mask b) { return {a.v | b.v}; }
  friend Mask operator!(Mask a) { return {~a.v}; }
};

struct Ints {
  IntVector v;

  Ints() = default;
  Ints(IntVector vector) : v(vector) {}
  Ints(i32 x) : v{x, x, x, x, x, x, x, x} {}
  friend Ints operator+(Ints a, Ints b) { return a.v + b.v; }
  friend Ints operator-(Ints a, Ints b) { return a.v - b.v; }
  friend Ints operator*(Ints a, Ints b) { return a.v * b.v; }
  friend Ints operator&(Ints a, Ints b) { return a.v & b.v; }
  friend Ints operator>>(Ints a, i32 n) { return a.v >> n; }
  friend Mask operator==(Ints a, Ints b) { return {a.v == b.v}; }
  friend Mask operator<(Ints a, Ints b) { return {a.v < b.v}; }
};

struct Floats {
  FloatVector v;

  Floats() = default;
  Floats(FloatVector vector) : v(vector) {}
  Floats(float x) : v{x, x, x, x, x, x, x, x} {}
  friend Floats operator+(Floats a, Floats b) { return a.v + b.v; }
  friend Floats operator-(Floats a, Floats b) { return a.v - b.v; }
  friend Floats operator*(Floats a, Floats b) { return a.v * b.v; }
  friend Floats operator/(Floats a, Floats b) { return a.v / b.v; }
  friend Floats operator-(Floats a) { return -a.v; }
  Floats& operator+=(Floats b) { return *this = *this + b; }
  Floats& operator-=(Floats b) { return *this = *this - b; }
  Floats& operator*=(Floats b) { return *this = *this * b; }
  Floats& operator/=(Floats b) { return *this = *this / b; }
  friend Mask operator<(Floats a, Floats b) { return {a.v < b.v}; }
  friend Mask operator>(Floats a, Floats b) { return {a.v > b.v}; }
  friend Mask operator<=(Floats a, Floats b) { return {a.v <= b.v}; }
  friend Mask operator>=(Floats a, Floats b) { return {a.v >= b.v}; }
  friend Mask operator==(Floats a, Floats b) { return {a.v == b.v}; }
};

/// A value of an enumeration in each lane.
template <class E>
struct Enums {
  Ints v;

  Enums() = default;
  Enums(Ints ints) : v(ints) {}
  Enums(E e) : v(i32(e)) {}
  friend Mask operator==(Enums a, Enums b) { return a.v == b.v; }
};

template <>
struct InLanes<Floats> {
  using Int = Ints;
  using Index = Ints;
  using Bool = Mask;
  template <class E>
  using Enum = Enums<E>;
};

// ---------------------------------------------------------------- what floats have of their own

/// Bit i: lane i.
inline u32 bits_of(Mask m) {
#if defined(__AVX2__)
  return u32(_mm256_movemask_ps(__m256(m.v)));
#else
  u32 bits = 0;
  for (u32 i = 0; i < kLanes; ++i) bits |= u32(m.v[i] != 0) << i;
  return bits;
#endif
}
inline bool any(Mask m) { return bits_of(m) != 0; }
inline bool all(Mask m) { return bits_of(m) == (1u << kLanes) - 1; }
/// i where the mask is true, which it is somewhere; elsewhere one of those.
inline Ints fill(Mask m, Ints i) {
  return (i.v & m.v) | (Ints(i.v[u32(__builtin_ctz(bits_of(m)))]).v & ~m.v);
}
/// Lanes 0 to count - 1.
inline Mask first_lanes(u32 count) {
  return Ints(IntVector{0, 1, 2, 3, 4, 5, 6, 7}) < Ints(i32(count));
}

inline Floats select(Mask m, Floats a, Floats b) {
#if defined(__AVX2__)
  return FloatVector(_mm256_blendv_ps(__m256(b.v), __m256(a.v), __m256(m.v)));
#else
  return m.v ? a.v : b.v;
#endif
}
inline Ints select(Mask m, Ints a, Ints b) { return (a.v & m.v) | (b.v & ~m.v); }
inline Vec3<Floats> select(Mask m, Vec3<Floats> a, Vec3<Floats> b) {
  return Vec3<Floats>(select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z));
}

inline Vec2<Floats> select(Mask m, Vec2<Floats> a, Vec2<Floats> b) {
  return Vec2<Floats>(select(m, a.x, b.x), select(m, a.y, b.y));
}
inline Mask select(Mask m, Mask a, Mask b) { return {(a.v & m.v) | (b.v & ~m.v)}; }
template <class E>
Enums<E> select(Mask m, Enums<E> a, Enums<E> b) {
  return {select(m, a.v, b.v)};
}
inline FrameOf<Floats> select(Mask m, const FrameOf<Floats>& a, const FrameOf<Floats>& b) {
  return {select(m, a.s, b.s), select(m, a.t, b.t), select(m, a.n, b.n)};
}
template <class F, class G>
HELIO_ALWAYS_INLINE inline auto either(Mask condition, const F& f, const G& g) {
  if (all(condition)) return f();
  if (!any(condition)) return g();
  return select(condition, f(), g());
}

inline Floats min2(Floats a, Floats b) {
#if defined(__AVX2__)
  return FloatVector(_mm256_min_ps(__m256(a.v), __m256(b.v)));
#else
  return a.v < b.v ? a.v : b.v;
#endif
}
inline Floats max2(Floats a, Floats b) {
#if defined(__AVX2__)
  return FloatVector(_mm256_max_ps(__m256(a.v), __m256(b.v)));
#else
  return a.v > b.v ? a.v : b.v;
#endif
}
inline Ints min2(Ints a, Ints b) { return select(a < b, a, b); }

inline Floats sqrt(Floats x) {
#if defined(__AVX2__)
  return FloatVector(_mm256_sqrt_ps(__m256(x.v)));
#else
  for (u32 i = 0; i < kLanes; ++i) x.v[i] = std::sqrt(x.v[i]);
  return x;
#endif
}
inline Floats floor(Floats x) {
#if defined(__AVX2__)
  return FloatVector(_mm256_floor_ps(__m256(x.v)));
#else
  for (u32 i = 0; i < kLanes; ++i) x.v[i] = std::floor(x.v[i]);
  return x;
#endif
}
inline Floats exp(Floats x) {
  for (u32 i = 0; i < kLanes; ++i) x.v[i] = std::exp(float(x.v[i]));
  return x;
}
inline Floats pow(Floats x, Floats y) {
  for (u32 i = 0; i < kLanes; ++i) x.v[i] = std::pow(float(x.v[i]), float(y.v[i]));
  return x;
}
inline Floats abs(Floats x) { return FloatVector(IntVector(x.v) & 0x7fffffff); }
inline Floats sign_of(Floats x) {
  return FloatVector((IntVector(x.v) & i32(0x80000000)) | IntVector(Floats(1).v));
}
inline Floats copysign(Floats x, Floats sign) {
  return FloatVector((IntVector(x.v) & 0x7fffffff) | (IntVector(sign.v) & i32(0x80000000)));
}
inline Floats scale_near_one(Floats x) {
  return FloatVector(0x7f000000 - (IntVector(x.v) & 0x7f800000));
}
inline Ints to_int(Floats x) { return __builtin_convertvector(x.v, IntVector); }
inline Floats to_float(Ints x) { return __builtin_convertvector(x.v, FloatVector); }

inline Vec3<Floats> normalize(Vec3<Floats> v) { return v * (1 / sqrt(dot(v, v))); }

// ---------------------------------------------------------------- memory

/// table[i] in each lane. Every i is one of the table.
inline Floats gather(const float* table, Ints i) {
#if defined(__AVX2__)
  return FloatVector(_mm256_i32gather_ps(table, __m256i(i.v), 4));
#else
  FloatVector v;
  for (u32 lane = 0; lane < kLanes; ++lane) v[lane] = table[i.v[lane]];
  return v;
#endif
}

#if defined(__AVX2__)
/// Four numbers of each lane, from row(i) of them, transposed.
template <class R>
HELIO_ALWAYS_INLINE inline FourOf<Floats> transposed(const R& row) {
  const auto pair = [&](u32 i) {
    return _mm256_insertf128_ps(_mm256_castps128_ps256(row(i)), row(i + 4), 1);
  };
  const __m256 a = pair(0), b = pair(1), c = pair(2), d = pair(3);
  const __m256 ab01 = _mm256_unpacklo_ps(a, b), ab23 = _mm256_unpackhi_ps(a, b);
  const __m256 cd01 = _mm256_unpacklo_ps(c, d), cd23 = _mm256_unpackhi_ps(c, d);
  return {{FloatVector(_mm256_shuffle_ps(ab01, cd01, 0x44)),
           FloatVector(_mm256_shuffle_ps(ab01, cd01, 0xee)),
           FloatVector(_mm256_shuffle_ps(ab23, cd23, 0x44)),
           FloatVector(_mm256_shuffle_ps(ab23, cd23, 0xee))}};
}
#endif

/// table[i] to table[i + 3] in each lane: rows of four are read whole and transposed, which takes
/// half of the time of four gather().
HELIO_ALWAYS_INLINE inline FourOf<Floats> gather4(const float* table, Ints i) {
#if defined(__AVX2__)
  return transposed([&](u32 lane) { return _mm_loadu_ps(table + i.v[lane]); });
#else
  return {{gather(table, i), gather(table, i + 1), gather(table, i + 2), gather(table, i + 3)}};
#endif
}

/// at(i)[0] to at(i)[3] of each lane i.
template <class A>
HELIO_ALWAYS_INLINE inline FourOf<Floats> read4(const A& at) {
#if defined(__AVX2__)
  return transposed([&](u32 lane) { return _mm_loadu_ps(at(lane)); });
#else
  FourOf<Floats> four;
  for (u32 lane = 0; lane < kLanes; ++lane)
    for (u32 k = 0; k < 4; ++k) four.of[k].v[lane] = at(lane)[k];
  return four;
#endif
}
/// The three numbers there; what lies after them is not read.
template <class A>
HELIO_ALWAYS_INLINE inline Vec3<Floats> read3(const A& at) {
#if defined(__AVX2__)
  const __m128i three = _mm_setr_epi32(-1, -1, -1, 0);
  const FourOf<Floats> four =
      transposed([&](u32 lane) { return _mm_maskload_ps(at(lane), three); });
  return Vec3<Floats>(four.of[0], four.of[1], four.of[2]);
#else
  Vec3<Floats> v;
  for (u32 lane = 0; lane < kLanes; ++lane)
    v.x.v[lane] = at(lane)[0], v.y.v[lane] = at(lane)[1], v.z.v[lane] = at(lane)[2];
  return v;
#endif
}
/// Writes four numbers of each lane i to at(i)[0] to at(i)[3].
template <class A>
HELIO_ALWAYS_INLINE inline void write4(const A& at, Floats x, Floats y, Floats z, Floats w) {
#if defined(__AVX2__)
  const __m256 xy01 = _mm256_unpacklo_ps(__m256(x.v), __m256(y.v));
  const __m256 xy23 = _mm256_unpackhi_ps(__m256(x.v), __m256(y.v));
  const __m256 zw01 = _mm256_unpacklo_ps(__m256(z.v), __m256(w.v));
  const __m256 zw23 = _mm256_unpackhi_ps(__m256(z.v), __m256(w.v));
  const __m256 pairs[4] = {_mm256_shuffle_ps(xy01, zw01, 0x44), _mm256_shuffle_ps(xy01, zw01, 0xee),
                           _mm256_shuffle_ps(xy23, zw23, 0x44),
                           _mm256_shuffle_ps(xy23, zw23, 0xee)};
  for (u32 lane = 0; lane < kLanes / 2; ++lane) {
    _mm_storeu_ps(at(lane), _mm256_castps256_ps128(pairs[lane]));
    _mm_storeu_ps(at(lane + 4), _mm256_extractf128_ps(pairs[lane], 1));
  }
#else
  for (u32 lane = 0; lane < kLanes; ++lane) {
    at(lane)[0] = x.v[lane], at(lane)[1] = y.v[lane], at(lane)[2] = z.v[lane];
    at(lane)[3] = w.v[lane];
  }
#endif
}

inline Ints gather(const u16* table, Ints i) {
  for (u32 lane = 0; lane < kLanes; ++lane) i.v[lane] = table[i.v[lane]];
  return i;
}

/// One lane of several, which lie in memory.
inline void put(Floats& lanes, u32 i, float x) { lanes.v[i] = x; }
inline void put(Ints& lanes, u32 i, i32 x) { lanes.v[i] = x; }
inline void put(Mask& lanes, u32 i, bool b) { lanes.v[i] = -i32(b); }
inline void put(Vec2<Floats>& lanes, u32 i, vec2 v) { put(lanes.x, i, v.x), put(lanes.y, i, v.y); }
inline void put(Vec3<Floats>& lanes, u32 i, vec3 v) {
  put(lanes.x, i, v.x), put(lanes.y, i, v.y), put(lanes.z, i, v.z);
}
inline float get(const Floats& lanes, u32 i) { return lanes.v[i]; }
inline i32 get(const Ints& lanes, u32 i) { return lanes.v[i]; }
inline bool get(const Mask& lanes, u32 i) { return lanes.v[i] != 0; }
inline vec2 get(const Vec2<Floats>& lanes, u32 i) { return vec2(get(lanes.x, i), get(lanes.y, i)); }
inline vec3 get(const Vec3<Floats>& lanes, u32 i) {
  return vec3(get(lanes.x, i), get(lanes.y, i), get(lanes.z, i));
}

/// A number of each lane, in memory.
struct alignas(4 * kLanes) Row {
  float of[kLanes];

  Row& operator=(Floats x) {
    *reinterpret_cast<FloatVector __attribute__((may_alias))*>(of) = x.v;
    return *this;
  }
  operator Floats() const {
    return *reinterpret_cast<const FloatVector __attribute__((may_alias))*>(of);
  }
};
struct Row3 {
  Row x, y, z;

  void set(u32 lane, vec3 v) { x.of[lane] = v.x, y.of[lane] = v.y, z.of[lane] = v.z; }
  [[nodiscard]] vec3 get(u32 lane) const { return vec3(x.of[lane], y.of[lane], z.of[lane]); }
  Row3& operator=(Vec3<Floats> v) {
    x = v.x, y = v.y, z = v.z;
    return *this;
  }
  operator Vec3<Floats>() const { return Vec3<Floats>(Floats(x), Floats(y), Floats(z)); }
};

}  // namespace heliograph::kernels::inline HELIO_ISA

/// GLM asks for it before it multiplies vectors of them.
template <>
struct std::numeric_limits<heliograph::kernels::Floats> : std::numeric_limits<float> {};
