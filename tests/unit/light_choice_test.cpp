// The choice among lamps, suns and the dome, and directions to a dome without a picture.
#include "kernels/core/sampler.h"
#include "kernels/light/light.h"
#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"
#include "tests/unit/moments.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

TEST_CASE("dome: without a picture, directions go by the receiver's cosine (1e-6)") {
  TestScene scene;
  scene.set_dome(vec3(1));
  const SceneView& view = scene.finish();
  for (const Facing facing : {Facing::kFront, Facing::kBoth, Facing::kAny}) {
    const Receiver receiver = receiver_at(view, vec3(0), normalize(vec3(1, 2, 2)), facing, 0);
    Random random;
    int same = 0;
    const auto sample = [&](double& x, double& y) {
      LightSample s;
      if (!sample_light(view, receiver, random.next2(), s)) return false;
      same += dome_pdf(view.dome, receiver, s.direction, {}) == Approx(s.pdf).epsilon(1e-3);
      x = std::atan2(double(s.direction.y), double(s.direction.x)) / (2 * M_PI) + 0.5;
      y = 0.5 + 0.5 * double(s.direction.z);
      return true;
    };
    const auto density = [&](double x, double y) {
      const double z = 2 * y - 1, r = std::sqrt(1 - z * z), phi = 2 * M_PI * (x - 0.5);
      const vec3 d(r * std::cos(phi), r * std::sin(phi), z);
      return 4 * M_PI * double(dome_pdf(view.dome, receiver, d, {}));
    };
    CHECK(square_p_value({20, 32, 100000}, sample, density) > kLevel);
    CHECK(same > 99900);
  }
}

namespace {

enum Emitters : u32 { kLamp = 1, kSun = 2, kSky = 4 };
struct Lit {
  TestScene scene;
  u32 lamp = kNone;
  explicit Lit(u32 emitters) {
    if (emitters & kLamp) {
      lamp = scene.add_instance(scene.add(rectangle(1, 1)), scene.add(emitter(vec3(20))),
                                pose(rotation({1, 0, 0}, kPi), {0, 0, 2}));
      scene.add_light(lamp);
    }
    if (emitters & kSun) {
      SunView sun{};
      sun.direction = normalize(vec3(1, 0, 1));
      sun.one_minus_cos = 1e-4f;
      sun.radiance = vec3(900);
      sun.visibility = kAllRays;
      scene.suns.push_back(sun);
    }
    if (emitters & kSky) scene.set_dome(vec3(0.5f));
    scene.finish();
  }
  Moments irradiance(vec3 p, vec3 n) const {
    const Receiver at = receiver_at(scene.view, p, n, Facing::kFront, 0);
    Random random;
    Moments moments;
    for (int i = 0; i < 100000; ++i) {
      LightSample s;
      const bool found = sample_light(scene.view, at, random.next2(), s);
      const float cosine = found ? max2(dot(s.direction, at.n), 0.0f) : 0;
      moments.add(found ? double(light_radiance(scene.view, s).y * cosine / s.pdf) : 0);
    }
    return moments;
  }
};

}  // namespace

TEST_CASE("light: lamps, suns and a dome together send what each sends alone (1e-6)") {
  const Lit all(kLamp | kSun | kSky);
  const SceneView& view = all.scene.view;
  for (const float z : {1.5f, 0.0f, -20.0f}) {
    const vec3 p(0.2f, 0, z), n(0, 0, 1);
    const Moments together = all.irradiance(p, n);
    double sum = 0, variance = together.variance();
    for (const u32 kind : {kLamp, kSun, kSky}) {
      const Moments alone = Lit(kind).irradiance(p, n);
      sum += alone.mean();
      variance += alone.variance();
    }
    INFO("z " << z << ": " << together.mean() << " and " << sum);
    CHECK(std::fabs(together.mean() - sum) < 5 * std::sqrt(variance / 100000));
    // The lamp is met with the density that it is sampled with.
    const Receiver at = receiver_at(view, p, n, Facing::kFront, 0);
    LightSample s;
    REQUIRE(sample_light(view, at, {0.5f * at.surface_share, 0.5f}, s));
    REQUIRE(s.light == 0);
    const TestTracer tracer(view);
    const Hit hit = tracer.closest({p, s.direction, INFINITY, 0, {}}, kAllRays);
    REQUIRE(hit.instance == all.lamp);
    CHECK(light_pdf(view, at, hit, s.direction, 0) == Approx(s.pdf).epsilon(1e-3));
  }
}

TEST_CASE("light: what is chosen more often is what may send more") {
  const Lit lit(kLamp | kSky);
  const auto share = [&](float z, vec3 n) {
    return receiver_at(lit.scene.view, {0, 0, z}, n, Facing::kFront, 0).surface_share;
  };
  const vec3 up(0, 0, 1);
  CHECK(share(1.9f, up) == 1 - kMinTechniqueShare);
  CHECK(share(-2, up) > share(-4, up));
  CHECK(share(-1000, up) == kMinTechniqueShare);
  CHECK(share(0, -up) == kMinTechniqueShare);  // its light does not come there
  const auto in_medium = [](const Lit& in) {
    return receiver_at(in.scene.view, vec3(0), vec3(0), Facing::kAny, 0).surface_share;
  };
  CHECK(in_medium(Lit(kLamp)) == 1);
  CHECK(in_medium(Lit(kSun | kSky)) == 0);
}

TEST_CASE("light: the samples of a pixel are stratified over each light") {
  TestScene scene;
  const u32 mesh = scene.add(rectangle(1, 1)), material = scene.add(emitter(vec3(1)));
  for (const float x : {-4.0f, -1.0f, 1.5f, 6.0f})
    scene.add_light(scene.add_instance(mesh, material, pose(rotation({1, 0, 0}, kPi), {x, 0, 2})));
  const SceneView& view = scene.finish();
  const Receiver at = receiver_at(view, vec3(0), vec3(0, 0, 1), Facing::kFront, 0);
  const auto received = [&](vec2 u) {
    LightSample s;
    return sample_light(view, at, u, s) ? double(s.direction.z / s.pdf) : 0;
  };
  Random random;
  Moments stratified, by_chance;
  for (u32 pixel = 0; pixel < 1000; ++pixel) {
    double sum = 0, other = 0;
    for (u32 i = 0; i < 64; ++i) {
      sum += received(Sampler(pixel_key(1, pixel, 0), i).get2(0));
      other += received(random.next2());
    }
    stratified.add(sum / 64);
    by_chance.add(other / 64);
  }
  INFO(stratified.variance() / by_chance.variance());
  CHECK(std::fabs(stratified.mean() - by_chance.mean()) <
        5 * std::sqrt(by_chance.variance() / 1000));
  CHECK(stratified.variance() < 0.15 * by_chance.variance());
}
