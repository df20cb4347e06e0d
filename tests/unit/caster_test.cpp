// Directions towards entities that focus light: their density, and what they change of a picture.
#include "kernels/light/caster.h"

#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

constexpr CasterView kCasters[] = {{{1, 0, 0.5f}, 0.6f},
                                   {.center = {0.4f, 0.3f, 2}, .radius = 0.9f, .mirror = 1},
                                   {{-2, 1, 0.1f}, 0.5f}};
constexpr CastLightView kLamp{{3, 0, 3}, 0.4f};

/// A floor, a sphere of some material and a small lamp above.
SceneView furnished(TestScene& scene, const MaterialView& floor, const MaterialView& ball) {
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(floor));
  scene.add_instance(scene.add(sphere(32)), scene.add(ball), pose(0.5f * mat3(1), {0, 0, 1.2f}));
  scene.add_light(scene.add_instance(scene.add(rectangle(0.3f, 0.3f)), scene.add(emitter(vec3(40))),
                                     pose(rotation({1, 0, 0}, kPi), {3, 0, 3})));
  return scene.finish();
}

MaterialView shiny(float metallic, float transmission) {
  MaterialView m = standard_material();
  m.constant.base_color = vec3(0.9f);
  m.constant.metallic = metallic;
  m.constant.transmission = transmission;
  m.constant.roughness = metallic > 0 ? 0.15f : 0.0f;
  return m;
}

struct Estimate {
  double mean = 0, variance = 0;  // of a picture's mean
};
Estimate estimate(const SceneView& scene, vec3 target, u32 pictures) {
  const CameraView camera = look_at(target + vec3(0, -3, 2.5f), target, {4, 4}, 0.1f);
  double sum = 0, squares = 0;
  for (u32 i = 0; i < pictures; ++i) {
    Settings settings = standard_settings(6);
    settings.seed = i;
    const double value = double(mean_beauty(scene, camera, settings, 32).y);
    sum += value;
    squares += value * value;
  }
  const double mean = sum / pictures;
  return {mean, (squares / pictures - mean * mean) * pictures / (pictures - 1)};
}

}  // namespace

TEST_CASE("casters: directions to them follow their density, level 1e-6") {
  SceneView scene{};
  scene.casters = kCasters;
  scene.caster_count = 3;
  scene.caster_probability = 0.2f;
  CasterCones cones;
  scene.cast_lights = &kLamp;
  scene.cast_light_count = 1;
  gather_caustic_targets(cones, scene, vec3(0), vec3(0, 0, 1));
  REQUIRE(cones.count == 4);
  Random random;
  const auto sample = [&](double& x, double& y) {
    const float choice = random.next();
    const CasterDirectionOf<float> to = sample_casters(cones, choice, random.next2());
    CHECK((to.rest >= 0 && to.rest < 1));
    to_square(to.wi, x, y);
    return true;
  };
  const auto density = [&](double x, double y) {
    return 4 * M_PI * double(casters_pdf(cones, from_square(x, y)));
  };
  CHECK(square_p_value({.cells = 20, .steps = 100, .samples = 20000}, sample, density) > kLevel);
}

TEST_CASE("casters: a point sees none that it is within, or that lies below its horizon") {
  SceneView scene{};
  scene.casters = kCasters;
  scene.caster_count = 3;
  CasterCones cones;
  gather_caustic_targets(cones, scene, {1, 0, 0.4f}, {0, 0, -1});
  CHECK(cones.count == 1);  // the last one, which reaches below
}

TEST_CASE("casters: fewer directions go to one that looks small") {
  const CasterView ball{{0, 0, 0}, 0.5f};
  SceneView scene{};
  scene.casters = &ball;
  scene.caster_count = 1;
  scene.caster_probability = 0.2f;
  const auto probability = [&](float distance) {
    CasterCones cones;
    gather_caustic_targets(cones, scene, {0, 0, -distance}, {0, 0, 1});
    return cones.probability;
  };
  CHECK(probability(0.6f) == 0.2f);
  CHECK(probability(2) == 0.2f);  // 3.2 % of the hemisphere
  const float at_10 = 1 - std::sqrt(1 - sqr(0.05f));
  CHECK(probability(10) == Approx(0.2f * at_10 / 0.03f).epsilon(1e-3));
  CHECK(probability(10) > 3.9f * probability(20));
}

TEST_CASE("casters: the image of a lamp in a mirror ball is where its light is reflected") {
  Random random;
  for (int i = 0; i < 100; ++i) {
    const auto place = [&] { return 4.0f * (vec3(random.next2(), random.next()) - 0.5f); };
    const CasterView ball{.center = place(), .radius = 0.5f, .mirror = 1};
    const CastLightView lamp{.center = ball.center + 3.0f * glm::normalize(place()),
                             .radius = 0.05f};
    const vec3 p = ball.center + 2.0f * glm::normalize(place());
    CasterCones cones;
    add_image(cones, ball, lamp, p, true, 1.0f, 1.0f);
    if (cones.count == 0) continue;
    // The ray to the image's middle, reflected by the ball, passes through the lamp or near it.
    const vec3 d = cones.axis[0], to = p - ball.center;
    const float b = dot(to, d), root = b * b - dot(to, to) + sqr(ball.radius);
    if (root < 0.05f * sqr(ball.radius)) continue;  // grazing: the two steps are not enough
    const vec3 q = p - (b + std::sqrt(root)) * d;
    const vec3 n = (q - ball.center) / ball.radius;
    const vec3 out = d - 2 * dot(d, n) * n;
    CHECK(glm::dot(out, glm::normalize(lamp.center - q)) > std::cos(0.1f));
  }
}

TEST_CASE("casters: the picture is the same, at less than a third of its variance") {
  MaterialView plastic = standard_material();
  plastic.constant.base_color = vec3(0.6f);
  const CasterView ball{.center = {0, 0, 1.2f}, .radius = 0.5f, .mirror = 1};
  for (const MaterialView& floor : {lambert(vec3(0.6f)), plastic}) {
    for (const MaterialView& material : {shiny(1, 0), shiny(0, 1)}) {
      const vec3 target(material.constant.metallic > 0 ? 1.2f : -2.0f, 0,
                        0);  // where its light falls
      TestScene made;
      SceneView scene = furnished(made, floor, material);
      const Estimate without = estimate(scene, target, 100);
      scene.casters = &ball;
      scene.caster_count = 1;
      scene.caster_probability = 0.2f;
      scene.cast_lights = &kLamp;
      scene.cast_light_count = 1;
      const Estimate with = estimate(scene, target, 100);
      const double error = std::sqrt((with.variance + without.variance) / 100);
      CHECK(std::abs(with.mean - without.mean) < 5 * error);
      CHECK(3 * with.variance < without.variance);
    }
  }
}
