// Suns as entities: where they shine, and what their units mean.
#include "renderer/schedule/engine.h"

#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

/// A sun that shines along `direction`.
Edits& add_sun(Edits& edits, const Light& light, vec3 direction) {
  return edits.pose("sun", look_at(-direction, vec3(0))).light("sun", light);
}

double floor_radiance(const Light& light, vec3 direction) {
  Edits edits;
  PutMaterial matte;
  matte.parameters[std::size_t(MaterialParameter::base_color)].value = vec3(0.5f);
  matte.parameters[std::size_t(MaterialParameter::specular)].value = vec3(0);
  edits.mesh("quad", quad())
      .put("matte", matte)
      .object("floor", "quad", scaled(vec3(8), vec3(0)), "matte");
  add_sun(edits, light, direction).camera("camera", look_at({0, 0, 3}, vec3(0)), 8, 8, 64);
  auto engine = make_engine();
  const auto frame = render(*engine, job_of(edits.apply(), {Plane::BEAUTY}, 64));
  double mean = 0;
  for (std::size_t i = 0; i < 64; ++i) mean += double(pixels<float>(*frame)[4 * i + 1]) / 64;
  return mean;
}

}  // namespace

TEST_CASE("sun: a floor's radiance in every unit") {
  const vec3 down = glm::normalize(vec3(1, 1, -2));
  const double cosine = double(-down.z), albedo = 0.5;
  const double sine = std::sin(0.5 * 0.02);
  Light light{.intensity = 200, .unit = LightUnit::kIrradiance, .sun_angle = 0.02f};
  CHECK(floor_radiance(light, down) == Approx(200 * cosine * albedo / M_PI).epsilon(1e-3));
  light.unit = LightUnit::kIlluminance;
  CHECK(floor_radiance(light, down) == Approx(200 / 683.0 * cosine * albedo / M_PI).epsilon(1e-3));
  light.unit = LightUnit::kRadiance;
  CHECK(floor_radiance(light, down) == Approx(200 * sine * sine * cosine * albedo).epsilon(1e-3));
  light.exposure = 2;
  CHECK(floor_radiance(light, down) ==
        Approx(4 * 200 * sine * sine * cosine * albedo).epsilon(1e-3));
  CHECK(floor_radiance(light, -down) == 0);
}

TEST_CASE("sun: the camera sees its disc unless it is hidden") {
  const Light light{.intensity = 7, .sun_angle = 0.1f};
  Edits edits;
  add_sun(edits, light, {0, 1, 0}).camera("camera", look_at({0, 0, 0}, {0, -1, 0}), 33, 33, 330);
  auto engine = make_engine();
  const auto middle = [&](const std::shared_ptr<const Snapshot>& scene) {
    const auto frame = render(*engine, job_of(scene, {Plane::BEAUTY}, 4));
    const auto beauty = pixels<float>(*frame);
    double lit = 0;
    for (std::size_t i = 0; i < 33 * 33; ++i) lit += double(beauty[4 * i]) / 7;
    return lit;
  };
  const auto scene = edits.apply();
  // 330 pixels a unit of tangent.
  CHECK(middle(scene) == Approx(M_PI * std::pow(330 * std::tan(0.05), 2)).epsilon(0.02));
  PutEntity hidden;
  hidden.visibility = u8(kAllRays & ~kCameraRay);
  CHECK(middle(Edits().put("sun", hidden).apply(*scene)) == 0);
}
