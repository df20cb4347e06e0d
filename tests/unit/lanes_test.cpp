// Numbers side by side: each lane has the bits of a float, whatever the others hold.
#include "kernels/core/lanes.h"

#include <bit>
#include <limits>

#include "kernels/bsdf/ggx.h"
#include "tests/unit/catch.h"
#include "tests/unit/random.h"

using namespace heliograph::kernels;
using namespace heliograph::test;
namespace kernels = heliograph::kernels;  // its names where the C library has them, too

namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

Floats from(const float (&values)[kLanes]) {
  Row row;
  for (u32 i = 0; i < kLanes; ++i) row.of[i] = values[i];
  return row;
}
Floats random_floats(Random& random, float scale) {
  float values[kLanes];
  for (float& value : values) value = scale * (2 * random.next() - 1);
  return from(values);
}
Vec3<Floats> random_vectors(Random& random, float scale) {
  return Vec3<Floats>(random_floats(random, scale), random_floats(random, scale),
                      random_floats(random, scale));
}
vec3 lane_of(const Vec3<Floats>& v, u32 i) { return vec3(v.x.v[i], v.y.v[i], v.z.v[i]); }

bool same(float a, float b) { return std::bit_cast<u32>(a) == std::bit_cast<u32>(b); }
bool same(vec3 a, vec3 b) { return same(a.x, b.x) && same(a.y, b.y) && same(a.z, b.z); }

/// f, which takes floats or Floats, gives the same.
template <class F>
void check_same(const F& f, Floats a, Floats b) {
  const Floats both = f(a, b);
  for (u32 i = 0; i < kLanes; ++i) {
    const float x = a.v[i], y = b.v[i];
    INFO(x << " " << y);
    CHECK(same(both.v[i], f(x, y)));
  }
}

const Floats kOdd = from({0, -0.0f, 1, -1, kInfinity, -kInfinity, 1e-40f, NAN});

}  // namespace

TEST_CASE("lanes: arithmetic, order and roots are those of floats") {
  Random random;
  for (int i = 0; i < 50; ++i) {
    const Floats a = i == 0 ? kOdd : random_floats(random, 100), b = random_floats(random, 100);
    check_same([](auto x, auto y) { return x + y * x - y / 3; }, a, b);
    check_same([](auto x, auto y) { return min2(x, y); }, a, b);
    check_same([](auto x, auto y) { return max2(y, x); }, a, b);
    check_same([](auto x, auto y) { return select(x < y, x, y) + select(x >= y, x, -y); }, a, b);
    check_same([](auto x, auto) { return kernels::floor(x); }, a, b);
    check_same([](auto x, auto y) { return kernels::abs(x) * sign_of(y); }, a, b);
    check_same([](auto x, auto) { return safe_sqrt(x); }, a, b);
    check_same([](auto x, auto) { return clamp01(x); }, a, b);
    check_same([](auto x, auto y) { return rescale_uniform(kernels::abs(x), kernels::abs(y)); }, b,
               b);
    check_same([](auto x, auto) { return to_float(to_int(kernels::abs(x))); }, b, b);
    check_same([](auto x, auto y) { return atan2_turns(x, y); }, b, b);
    check_same([](auto x, auto y) { return atan2_turns(x, y); }, a, b);
  }
}

TEST_CASE("lanes: vectors, frames, angles and microfacets are those of floats") {
  Random random;
  for (int i = 0; i < 50; ++i) {
    const Vec3<Floats> v = random_vectors(random, 3);
    const Vec3<Floats> n = normalize(v);
    const FrameOf<Floats> frame = make_frame(n);
    const Vec3<Floats> local = to_local(frame, v);
    const Floats turns = random_floats(random, 3);
    const SinCosOf<Floats> angle = sincos_turns(turns);
    const Floats alpha = kernels::abs(random_floats(random, 1)) + 0.01f;
    const AlbedoOf<Floats> albedo = albedo_at(albedo_row(alpha), turns);
    const Vec3<Floats> wo(n.x, n.y, kernels::abs(n.z) + 0.01f);
    const Vec2<Floats> u(kernels::abs(random_floats(random, 1)),
                         kernels::abs(random_floats(random, 1)));
    const Vec3<Floats> h = sample_ggx(wo, GgxOf<Floats>{alpha, alpha}, u);
    for (u32 k = 0; k < kLanes; ++k) {
      const vec3 one = lane_of(v, k), unit = normalize(one);
      CHECK(same(lane_of(n, k), unit));
      CHECK(same(lane_of(local, k), to_local(make_frame(unit), one)));
      CHECK(same(angle.sin.v[k], sincos_turns(float(turns.v[k])).sin));
      CHECK(same(angle.cos.v[k], sincos_turns(float(turns.v[k])).cos));
      const float a = alpha.v[k];
      CHECK(same(albedo.schlick.v[k], albedo_at(albedo_row(a), float(turns.v[k])).schlick));
      const vec2 place(u.x.v[k], u.y.v[k]);
      CHECK(same(lane_of(h, k), sample_ggx(lane_of(wo, k), Ggx{a, a}, place)));
    }
  }
}

TEST_CASE("lanes: masks, tables and memory") {
  const Floats x = from({0, 1, 2, 3, 4, 5, 6, 7});
  CHECK(bits_of(x < 3) == 0b111);
  CHECK(bits_of(!(x < 3)) == 0b11111000);
  CHECK(bits_of((x > 1) & (x <= 4)) == 0b11100);
  CHECK(bits_of((x < 1) | (x == 7)) == 0b10000001);
  CHECK(bits_of(first_lanes(5)) == 0b11111);
  CHECK(any(x > 6));
  CHECK_FALSE(any(x > 7));
  CHECK(all(x >= 0));
  CHECK_FALSE(all(x > 0));
  const float table[]{5, 6, 7, 8, 9, 10, 11, 12};
  CHECK(bits_of(gather(table, 7 - to_int(x)) == 12 - x) == 0xff);
  const u16 words[]{9, 8, 7, 6, 5, 4, 3, 2};
  CHECK(bits_of(gather(words, to_int(x) >> 1) == Ints(IntVector{9, 9, 8, 8, 7, 7, 6, 6})) == 0xff);
  Row3 rows;
  rows = Vec3<Floats>(x, x + 1, x + 2);
  CHECK(rows.get(3) == vec3(3, 4, 5));
  rows.set(3, vec3(9));
  CHECK(lane_of(rows, 3) == vec3(9));
  CHECK(rows.get(4) == vec3(4, 5, 6));
}
