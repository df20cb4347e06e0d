// Media inside meshes: what passes, what is scattered, and what a path is inside of; against closed
// forms, quadrature and furnaces.
#include "kernels/schedule/scalar.h"
#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

/// The boundary of a medium: glass of some index.
MaterialView clear(float ior = 1) {
  MaterialView m = standard_material();
  m.constant.base_color = vec3(1);
  m.constant.roughness = 0;
  m.constant.transmission = 1;
  m.constant.ior = ior;
  return m;
}
constexpr vec3 kColor(0.9f, 0.5f, 0.1f);
MaterialView absorbing(float ior = 1) {
  MaterialView m = clear(ior);
  m.constant.attenuation_color = kColor;
  m.constant.attenuation_distance = 0.5f;
  return m;
}
MaterialView scattering(vec3 density, vec3 albedo, float g = 0, float ior = 1) {
  MaterialView m = clear(ior);
  m.constant.medium_density = density;
  m.constant.medium_albedo = albedo;
  m.constant.medium_anisotropy = g;
  return m;
}

/// What kColor becomes after a distance.
vec3 left_after(float distance) { return glm::pow(kColor, vec3(distance / 0.5f)); }

void check(vec3 got, vec3 expected, double tolerance) {
  for (int c = 0; c < 3; ++c) {
    CHECK(double(got[c]) == Approx(double(expected[c])).epsilon(tolerance));
  }
}

/// A camera far away on the z axis that looks at the origin through a keyhole.
CameraView keyhole(float z, u32 size = 1) {
  return look_at({0.01f, 0.02f, z}, {0.01f, 0.02f, 0}, {size, size}, 0.002f);
}

SunView sun(vec3 direction, float irradiance) {
  const float depth = 1e-5f;
  return {.direction = normalize(direction),
          .one_minus_cos = depth,
          .radiance = vec3(irradiance / (2 * kPi * depth)),
          .probability = 1,
          .visibility = kAllRays};
}

}  // namespace

TEST_CASE("medium: a slab lets exp(-sigma d) pass, by colour") {
  for (const float thickness : {0.1f, 0.7f}) {
    TestScene scene;
    scene.add_instance(scene.add(block({9, 9, 0.5f * thickness})), scene.add(absorbing()));
    scene.set_dome(vec3(1, 2, 3));
    const vec3 got = mean_beauty(scene.finish(), keyhole(5), standard_settings(1), 16);
    check(got, left_after(thickness) * vec3(1, 2, 3), 1e-3);
  }
}

TEST_CASE("medium: absorbing glass, with all that its faces reflect") {
  const float thickness = 0.4f;
  TestScene scene;
  scene.add_instance(scene.add(block({9, 9, 0.5f * thickness})), scene.add(absorbing(1.5f)));
  scene.set_dome(vec3(1));
  const vec3 got = mean_beauty(scene.finish(), keyhole(5), standard_settings(40), 4096);
  const vec3 t = left_after(thickness);
  const float r = 0.04f;
  const vec3 loops = vec3(1) / (vec3(1) - r * r * t * t);
  check(got, vec3(r) + (1 - r) * (1 - r) * t * (vec3(1) + r * t) * loops, 0.01);
}

TEST_CASE("medium: the camera may start inside, also within a clear ball") {
  const float radius = 0.3f;
  for (const bool ball : {false, true}) {
    TestScene scene;
    scene.add_instance(scene.add(block(vec3(0.5f))), scene.add(absorbing()));
    if (ball) {
      scene.add_instance(scene.add(sphere(64)), scene.add(clear()),
                         pose(mat3(radius), {0.01f, 0.02f, 0}));
    }
    scene.set_dome(vec3(1));
    const SceneView& view = scene.finish();
    // From the origin to the top, from below through everything, from above the ball.
    const auto look = [&](float z, float towards) {
      const CameraView camera = look_at({0.01f, 0.02f, z}, {0.01f, 0.02f, towards}, {1, 1}, 0.002f);
      return mean_beauty(view, camera, standard_settings(1), 4);
    };
    const float hole = ball ? radius : 0;
    check(look(0, 9), left_after(0.5f - hole), 2e-3);
    check(look(-9, 0), left_after(1 - 2 * hole), 2e-3);
    check(look(0.4f, 0), left_after(0.9f - 2 * hole), 2e-3);
    check(look(0.4f, 9), left_after(0.1f), 2e-3);
  }
}

TEST_CASE("medium: light that passes a boundary of index 1 also lights what lies behind it") {
  for (const bool inside : {false, true}) {
    TestScene scene;
    scene.add_instance(scene.add(rectangle(5, 5)), scene.add(lambert(vec3(0.5f))),
                       pose(mat3(1), {0, 0, inside ? -0.2f : -1.0f}));
    MaterialView tinted = absorbing();
    tinted.constant.base_color = vec3(0.25f, 1, 1);
    scene.add_instance(scene.add(block({9, 9, 0.3f})), scene.add(tinted));
    scene.suns.push_back(sun({0, 0, 1}, 2));
    const SceneView& view = scene.finish();
    CHECK(view.any_passable);
    const float z = inside ? 0.2f : -0.5f;
    const CameraView camera = look_at({0.01f, 0.02f, z}, {0.01f, 0.02f, -2}, {1, 1}, 0.002f);
    const vec3 got = mean_beauty(view, camera, standard_settings(2), 16);
    const vec3 way =
        inside ? left_after(0.5f + 0.4f) * vec3(0.5f, 1, 1) : left_after(0.6f) * vec3(0.25f, 1, 1);
    check(got, way * 0.5f * kInvPi * 2.0f, 2e-3);
  }
}

TEST_CASE(
    "medium: boundaries that refract hold shadow rays up; paths find the light all the same") {
  vec3 results[2];
  for (const bool sampled : {false, true}) {
    TestScene scene;
    scene.add_instance(scene.add(sphere(24)),
                       scene.add(scattering(vec3(1, 2, 3), vec3(0.9f, 0.8f, 0.7f), 0.3f, 1.3f)));
    const u32 lamp = scene.add_instance(scene.add(sphere(12)), scene.add(emitter(vec3(4))),
                                        pose(mat3(0.8f), {0, 0, 3}));
    if (sampled) scene.add_light(lamp);
    results[sampled] = mean_beauty(scene.finish(), look_at({4, 0, 1}, {0, 0, 0}, {8, 8}, 0.4f),
                                   standard_settings(12), 4096);
  }
  check(results[1], results[0], 0.03);
}

TEST_CASE("medium: with and without sampled lights fog looks the same") {
  for (const float g : {-0.4f, 0.7f}) {
    vec3 results[2];
    for (const bool sampled : {false, true}) {
      TestScene scene;
      scene.add_instance(scene.add(block(vec3(2.5f))),
                         scene.add(scattering(vec3(0.2f, 0.4f, 0.6f), vec3(0.9f), g)));
      scene.add_instance(scene.add(rectangle(2, 2)), scene.add(lambert(vec3(0.5f))),
                         pose(mat3(1), {0, 0, -1}));
      const u32 lamp =
          scene.add_instance(scene.add(rectangle(0.8f, 0.8f)), scene.add(emitter(vec3(4, 5, 6))),
                             pose(rotation({1, 0, 0}, kPi), {0, 0, 2}));
      const u32 outside = scene.add_instance(scene.add(sphere(8)), scene.add(emitter(vec3(3))),
                                             pose(mat3(1), {4, 0, 0}));
      if (sampled) scene.add_light(lamp);
      if (sampled) scene.add_light(outside);
      results[sampled] = mean_beauty(scene.finish(), look_at({0, -2, 0}, {0, 0, 0}, {8, 8}, 1),
                                     standard_settings(6), sampled ? 2048 : 8192);
    }
    check(results[1], results[0], 0.03);
  }
}

TEST_CASE("medium: single scattering in a slab, by colour") {
  const vec3 density(0.5f, 1, 4), albedo(0.9f, 0.5f, 0.8f);
  const float g = 0.4f, thickness = 0.8f;
  TestScene scene;
  scene.add_instance(scene.add(block({99, 99, 0.5f * thickness})),
                     scene.add(scattering(density, albedo, g)));
  const vec3 to_sun = normalize(vec3(1, 0, 1));
  scene.suns.push_back(sun(to_sun, 3));
  const vec3 got = mean_beauty(scene.finish(), keyhole(5, 4), standard_settings(2), 4096);
  // The camera looks along -z: sunlight turns by the angle between -to_sun and +z.
  const float turned = phase_density(g, -to_sun.z);
  const vec3 rate = density * (1 + 1 / to_sun.z);
  const vec3 expected =
      albedo * density * 3.0f * turned * (vec3(1) - glm::exp(-rate * thickness)) / rate;
  check(got, expected, 0.01);
}

TEST_CASE("medium: single scattering in a ball against quadrature") {
  const float density = 1.5f, g = -0.3f;
  TestScene scene;
  scene.add_instance(scene.add(sphere(96)), scene.add(scattering(vec3(density), vec3(0.7f), g)));
  scene.suns.push_back(sun({1, 0, 0}, 2));
  const float x = 0.3f;
  const CameraView camera = look_at({x, 0.02f, 5}, {x, 0.02f, 0}, {4, 4}, 0.002f);
  const vec3 got = mean_beauty(scene.finish(), camera, standard_settings(2), 4096);
  double sum = 0;
  const double half = std::sqrt(1 - 0.09 - 4e-4);
  constexpr int kSteps = 10000;
  for (int i = 0; i < kSteps; ++i) {
    const double z = half * (1 - 2 * (i + 0.5) / kSteps);
    const double to_sun = std::sqrt(1 - z * z - 4e-4) - double(x);
    sum += std::exp(-double(density) * (half - z + to_sun)) * 2 * half / kSteps;
  }
  const double expected = 0.7 * double(density * phase_density(g, 0)) * 2 * sum;
  check(got, vec3(float(expected)), 0.01);
}

TEST_CASE("medium: what scatters all light vanishes in a furnace") {
  for (const MaterialView& m :
       {scattering(vec3(3), vec3(1)), scattering(vec3(1, 4, 9), vec3(1)),
        scattering(vec3(4), vec3(1), 0.8f), scattering(vec3(2, 3, 4), vec3(1), 0, 1.4f)}) {
    TestScene scene;
    scene.add_instance(scene.add(sphere(24)), scene.add(m));
    scene.set_dome(vec3(1));
    const CameraView camera = look_at({0, 0, 4}, {0, 0, 0}, {8, 8}, 0.28f);
    check(mean_beauty(scene.finish(), camera, standard_settings(2000), 1024), vec3(1), 0.02);
  }
}

TEST_CASE("medium: what absorbs gives off less than it gets, the more the denser") {
  float before = 1;
  for (const float density : {0.2f, 1.0f, 5.0f}) {
    TestScene scene;
    scene.add_instance(scene.add(sphere(24)), scene.add(scattering(vec3(density), vec3(0.8f))));
    scene.set_dome(vec3(1));
    const CameraView camera = look_at({0, 0, 4}, {0, 0, 0}, {8, 8}, 0.28f);
    const float got = mean_beauty(scene.finish(), camera, standard_settings(200), 256).y;
    CHECK(got < before - 0.05f);
    before = got;
  }
}

TEST_CASE("medium: the planes of light sum to beauty, and alpha counts what passes") {
  TestScene scene;
  scene.add_instance(scene.add(sphere(24)),
                     scene.add(scattering(vec3(0.7f), vec3(0.9f, 0.6f, 0.8f))));
  scene.set_dome(vec3(1, 2, 3));
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  Settings settings = standard_settings(8);
  const TestFilm film({1, 1}, planes_of(Fold::kMean));
  render_pixel(view, keyhole(5), settings, tracer, film.view, 0, 0, 0, 4096);
  const auto mean = [&](Plane plane, int c) { return film.mean(plane, u64(c), 4096); };
  for (int c = 0; c < 3; ++c) {
    double sum = 0;
    for (u32 i = 0; i < kLightPlanes; ++i) {
      sum += double(mean(Plane(u32(Plane::DIRECT_DIFFUSE) + i), c));
    }
    CHECK(sum == Approx(double(mean(Plane::BEAUTY, c))).epsilon(1e-4));
    CHECK(mean(Plane::DIRECT_VOLUME, c) > mean(Plane::INDIRECT_VOLUME, c));
    CHECK(mean(Plane::INDIRECT_VOLUME, c) > 0);
    CHECK(mean(Plane::DIRECT_TRANSMISSION, c) == 0);
  }
  const float passed = std::exp(-0.7f * 2);
  CHECK(mean(Plane::ENVIRONMENT_LIGHT, 1) == Approx(2 * passed).epsilon(0.03));
  CHECK(mean(Plane::COVERAGE, 0) == 1);
  CHECK(mean(Plane::BEAUTY, 3) == 1);
  settings.transparent_background = true;
  const TestFilm cut({1, 1}, kBeauty);
  render_pixel(view, keyhole(5), settings, tracer, cut.view, 0, 0, 0, 4096);
  CHECK(cut.mean(Plane::BEAUTY, 3, 4096) == Approx(1 - passed).epsilon(0.02));
}

TEST_CASE("medium: pictures repeat, however their samples are split") {
  TestScene scene;
  MaterialView m = scattering(vec3(1, 2, 3), vec3(0.9f));
  scene.add_instance(scene.add(sphere(12)), scene.add(m));
  m = lambert(vec3(0.5f));
  m.constant.subsurface = 0.8f;
  m.constant.subsurface_radius = vec3(0.1f, 0.2f, 0.3f);
  scene.add_instance(scene.add(block(vec3(0.3f))), scene.add(m));
  scene.set_dome(vec3(1));
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  const CameraView camera = look_at({0, 0, 4}, {0, 0, 0}, {1, 1}, 0.2f);
  const TestFilm whole({1, 1}, kBeauty), parts({1, 1}, kBeauty);
  const Settings settings = standard_settings(8);
  render_pixel(view, camera, settings, tracer, whole.view, 0, 0, 0, 64);
  for (u32 i = 0; i < 64; i += 16) {
    render_pixel(view, camera, settings, tracer, parts.view, 0, 0, i, 16);
  }
  for (u64 c = 0; c < 3; ++c) {
    CHECK(whole.mean(Plane::BEAUTY, c, 64) == parts.mean(Plane::BEAUTY, c, 64));
  }
}

TEST_CASE("medium: surfaces are left as they were entered") {
  TestScene scene;
  const u32 mesh = scene.add(rectangle(1, 1));
  MaterialView a = absorbing(), b = absorbing();
  b.constant.attenuation_distance = 2;
  scene.add_instance(mesh, scene.add(a));
  scene.add_instance(mesh, scene.add(b));
  const SceneView& view = scene.finish();
  Surface first = locate(view, 0, 0, vec2(0.3f), 0), second = locate(view, 1, 0, vec2(0.3f), 0);
  const vec3 in(0, 0, -1), out(0, 0, 1);
  Inside inside;
  const auto cross = [&](const Surface& s, vec3 d) {
    cross_surface(inside, s, s.material->constant, d);
  };
  cross(first, in);
  cross(second, in);
  CHECK(interior_in(inside).extinction.y == Approx(-std::log(0.5) / 2));
  cross(first, out);  // overlapping, not nested
  CHECK(inside.depth == 1);
  CHECK(interior_in(inside).extinction.y == Approx(-std::log(0.5) / 2));
  cross(first, out);  // was never entered again
  CHECK(inside.depth == 1);
  cross(second, in);  // two shells of one mesh
  cross(second, out);
  CHECK(inside.depth == 1);
  for (u32 i = 0; i < 9; ++i) cross(first, in);
  CHECK(inside.depth == kMaxMediumDepth);
  MaterialView sheet = a;
  sheet.thin_walled = true;
  first.material = &sheet;
  cross(first, out);
  CHECK(inside.depth == kMaxMediumDepth);
}
