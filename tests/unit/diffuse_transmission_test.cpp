// Light that leaves the far side of leaves, paper and cloth as Lambert's law has it.
#include "tests/unit/catch.h"
#include "tests/unit/principled.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

/// Passes `share` of its light on.
MaterialValues leaf(float share, vec3 reflects, vec3 passes) {
  MaterialValues m = standard();
  m.base_color = reflects;
  m.diffuse_transmission = share;
  m.diffuse_transmission_color = passes;
  m.specular = 0;
  return m;
}

vec3 value(const Config& c, vec3 wo, vec3 wi) {
  const BsdfValue f = evaluate_bsdf(bsdf_of(c, wo), wi);
  return f.diffuse + f.glossy;
}

void check_near(vec3 a, vec3 b, double tolerance) {
  for (int i = 0; i < 3; ++i) CHECK(double(a[i]) == Approx(double(b[i])).margin(tolerance));
}

/// Radiance of a wall of 2 x 2 m seen straight on; a sphere of radiance 1 lights its far side.
vec3 lit_from_behind(const MaterialView& material, bool sample_lights) {
  TestScene scene;
  scene.add_instance(scene.add(rectangle(1, 1)), scene.add(material));
  const u32 lamp = scene.add_instance(scene.add(sphere(48)), scene.add(emitter(vec3(1))),
                                      pose(mat3(1), vec3(0, 0, -2.5f)));
  if (sample_lights) scene.add_light(lamp);
  const CameraView camera = look_at({0, 0, 4}, {0, 0, 0}, {4, 4}, 0.002f);
  Settings settings = standard_settings(64);
  settings.max_depth = 2;
  return mean_beauty(scene.finish(), camera, settings, sample_lights ? 256 : 2048);
}

}  // namespace

TEST_CASE("diffuse transmission: both sides have Lambert's closed form") {
  const vec3 reflects(0.2f, 0.5f, 0.1f), passes(0.3f, 0.6f, 0.05f);
  const Config c{"leaf", leaf(0.7f, reflects, passes)};
  for (const bool front : {true, false}) {
    const vec3 wo = direction_at(0.6f, front);
    const float side = front ? 1.0f : -1.0f;
    check_near(value(c, wo, vec3(0, 0.6f, 0.8f * side)), reflects * (0.3f * 0.8f * kInvPi), 1e-6);
    check_near(value(c, wo, vec3(0, 0.6f, -0.8f * side)), passes * (0.7f * 0.8f * kInvPi), 1e-6);
  }
}

TEST_CASE("diffuse transmission: a coat and cloth let as much in on one side as out on the other") {
  Random random(3);
  for (int i = 0; i < 200; ++i) {
    Config c{"coated", leaf(random.next(), vec3(0.9f, 0.5f, 0.2f), vec3(0.1f, 0.6f, 0.8f))};
    c.m.specular = 1;
    c.m.roughness = random.next();
    c.m.clearcoat = random.next() < 0.5f ? 0 : random.next();
    c.m.sheen = random.next() < 0.5f ? 0 : random.next();
    const vec3 a = direction_at(0.1f + 0.9f * random.next());
    const vec3 b = vec3(0.6f, 0, -0.8f);
    const vec3 one = value(c, a, b) * std::fabs(a.z), other = value(c, b, a) * std::fabs(b.z);
    check_near(one, other, 1e-4 * double(max_component(one)) + 1e-7);
  }
}

TEST_CASE("diffuse transmission: light behind a sheet, sampled and met by chance") {
  MaterialView m = standard_material();
  m.constant = leaf(1, vec3(0), vec3(0.8f, 0.4f, 0.2f));
  // A ball of angular radius asin(1 / 2.5), straight behind: irradiance pi sin^2.
  const vec3 expected = m.constant.diffuse_transmission_color * 0.16f;
  check_near(lit_from_behind(m, true), expected, 0.002);
  check_near(lit_from_behind(m, false), expected, 0.006);
}

TEST_CASE("diffuse transmission: no light goes through metal, glass or a body in its place") {
  Config c{"metal", leaf(1, vec3(0.9f), vec3(1))};
  c.m.metallic = 1;
  CHECK(is_black(value(c, kUp, vec3(0, 0.6f, -0.8f))));
  c = {"glass", leaf(1, vec3(0.9f), vec3(1))};
  c.m.transmission = 1;
  c.m.roughness = 0;
  CHECK(is_black(value(c, kUp, vec3(0, 0.6f, -0.8f))));
  c = {"body", leaf(1, vec3(0.9f), vec3(1))};
  c.m.subsurface = 1;
  CHECK(is_black(value(c, kUp, vec3(0, 0.6f, -0.8f))));
}
