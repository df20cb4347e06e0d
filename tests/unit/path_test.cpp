// Whole paths: agreement of strategies, planes of light paths, holes, interfaces, visibility.
#include "kernels/schedule/scalar.h"

#include <random>

#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

/// A room with an emitting panel, a sphere of some material, a floor that shines a little.
void furnish(TestScene& scene, const MaterialView& material, bool sampled_light) {
  MaterialView glossy = lambert(vec3(0.6f, 0.5f, 0.4f));
  glossy.constant.specular = 1;
  glossy.constant.roughness = 0.4f;
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(glossy), pose(mat3(1), {0, 0, -1}));
  scene.add_instance(scene.add(sphere(24)), scene.add(material));
  const u32 lamp =
      scene.add_instance(scene.add(rectangle(1.5f, 1.5f)), scene.add(emitter(vec3(4, 5, 6))),
                         pose(rotation({1, 0, 0}, kPi), {0.5f, 0.3f, 3}));
  if (sampled_light) scene.add_light(lamp);
}

CameraView room_camera(u32 size) { return look_at({3, -3, 2}, {0, 0, -0.2f}, {size, size}, 0.8f); }

MaterialView plastic(float roughness, float metallic = 0, float transmission = 0) {
  MaterialView m = standard_material();
  m.constant.base_color = vec3(0.7f, 0.5f, 0.3f);
  m.constant.roughness = roughness;
  m.constant.metallic = metallic;
  m.constant.transmission = transmission;
  return m;
}

}  // namespace

TEST_CASE("path: with and without sampled lights the picture is the same") {
  for (const MaterialView& m :
       {plastic(0.4f), plastic(0.2f, 1), plastic(0.3f, 0, 1), plastic(0, 0, 0.7f)}) {
    TestScene with, without;
    furnish(with, m, true);
    furnish(without, m, false);
    const CameraView camera = room_camera(8);
    const vec3 a = mean_beauty(with.finish(), camera, standard_settings(6), 1024);
    const vec3 b = mean_beauty(without.finish(), camera, standard_settings(6), 8192);
    for (int c = 0; c < 3; ++c) CHECK(a[c] == Approx(b[c]).epsilon(0.015));
  }
}

TEST_CASE("path: a sampled dome and one met by chance agree") {
  std::vector<float> texels(size_t(64) * 32 * 3, 0.3f);
  for (int i = 0; i < 6; ++i) texels[size_t(8 * 64 + 20) * 3 + size_t(i)] = 40;
  vec3 results[2];
  for (const bool sampled : {false, true}) {
    TestScene scene;
    scene.add_instance(scene.add(rectangle(4, 4)), scene.add(lambert(vec3(0.5f))),
                       pose(mat3(1), {0, 0, -1}));
    scene.add_instance(scene.add(sphere(24)), scene.add(plastic(0.3f)));
    scene.set_dome(vec3(1), scene.add_texture(texels, {64, 32}, TexelType::kF32));
    SceneView view = scene.finish();
    if (!sampled) view.dome.probability = 0;
    results[sampled] =
        mean_beauty(view, room_camera(8), standard_settings(5), sampled ? 1024 : 16384);
  }
  for (int c = 0; c < 3; ++c) CHECK(results[0][c] == Approx(results[1][c]).epsilon(0.015));
}

TEST_CASE("path: Russian roulette changes no mean, wherever it begins") {
  const u32 first = GENERATE(1u, 3u);
  TestScene scene;
  furnish(scene, plastic(0.3f, 0, 1), true);
  const SceneView& view = scene.finish();
  Settings settings = standard_settings(12);
  const vec3 a = mean_beauty(view, room_camera(8), settings, 2048);
  settings.roulette_depth = first;
  const vec3 b = mean_beauty(view, room_camera(8), settings, 2048);
  CHECK(a.y != b.y);
  CHECK(a.y == Approx(b.y).epsilon(0.01));
}

TEST_CASE("path: the planes of light sum to beauty, whatever the material") {
  for (const MaterialView& m : {plastic(0.4f), plastic(0.05f, 1), plastic(0.3f, 0.3f, 0.6f)}) {
    TestScene scene;
    furnish(scene, m, true);
    scene.set_dome(vec3(0.1f, 0.2f, 0.3f));
    const SceneView& view = scene.finish();
    const TestTracer tracer(view);
    const CameraView camera = room_camera(8);
    const TestFilm film({8, 8}, kBeauty | kLightPlaneSet);
    double planes[kLightPlanes] = {};
    for (u32 y = 0; y < 8; ++y) {
      for (u32 x = 0; x < 8; ++x) {
        render_pixel(view, camera, standard_settings(6), tracer, film.view, x, y, 0, 40);
        for (int c = 0; c < 3; ++c) {
          double sum = 0;
          for (u32 i = 0; i < kLightPlanes; ++i) {
            const Plane plane = Plane(u32(Plane::DIRECT_DIFFUSE) + i);
            const double value = film.mean(plane, 3 * (y * 8 + x) + u32(c), 40);
            REQUIRE(value >= 0);
            planes[i] += value;
            sum += value;
          }
          const float beauty = film.mean(Plane::BEAUTY, 4 * (y * 8 + x) + u32(c), 40);
          REQUIRE(sum == Approx(beauty).epsilon(1e-5).margin(1e-6));
        }
      }
    }
    const bool transmits = m.constant.transmission > 0;
    // A closed glass body lets no light through its first interface alone (4); the lamp is not in
    // view (6).
    const bool expected[kLightPlanes] = {true,  true,  true,  true,  false, transmits,
                                         false, false, false, false, false, true};
    for (u32 i = 0; i < kLightPlanes; ++i) {
      INFO(i);
      CHECK((planes[i] > 0) == expected[i]);
    }
  }
}

TEST_CASE("path: beauty does not depend on the other planes, nor on how samples are split") {
  TestScene scene;
  furnish(scene, plastic(0.3f, 0.2f, 0.3f), true);
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  const CameraView camera = room_camera(4);
  const TestFilm a({4, 4}, kBeauty), b({4, 4}, planes_of(Fold::kMean) & ~plane_bit(Plane::COST));
  for (u32 y = 0; y < 4; ++y) {
    for (u32 x = 0; x < 4; ++x) {
      render_pixel(view, camera, standard_settings(5), tracer, a.view, x, y, 0, 45);
      for (u32 first : {0u, 5u, 16u, 17u, 40u}) {
        const u32 next = first == 0    ? 5
                         : first == 5  ? 16
                         : first == 16 ? 17
                         : first == 17 ? 40
                                       : 45;
        render_pixel(view, camera, standard_settings(5), tracer, b.view, x, y, first, next - first);
      }
      for (u32 c = 0; c < 4; ++c) {
        const u64 i = 4 * (y * 4 + x) + c;
        REQUIRE(a.mean(Plane::BEAUTY, i, 45) == b.mean(Plane::BEAUTY, i, 45));
      }
      const PixelStatistics s = pixel_statistics(a.view, y * 4 + x, 45);
      REQUIRE((s.variance >= 0 && std::isfinite(s.variance)));
    }
  }
}

TEST_CASE("path: the variance is that of the mean") {
  TestScene scene;
  furnish(scene, plastic(0.4f), false);
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  const CameraView camera = room_camera(2);
  double spread = 0, claimed = 0;
  const int runs = 200;
  std::vector<double> means;
  for (int seed = 0; seed < runs; ++seed) {
    Settings settings = standard_settings(3);
    settings.seed = u64(seed);
    const TestFilm film({2, 2}, kBeauty);
    render_pixel(view, camera, settings, tracer, film.view, 0, 1, 0, 32);
    const PixelStatistics s = pixel_statistics(film.view, 2, 32);
    means.push_back(s.mean);
    claimed += double(s.variance) / runs;
  }
  double mean = 0;
  for (double m : means) mean += m / runs;
  for (double m : means) spread += (m - mean) * (m - mean) / (runs - 1);
  // Stratification makes the true spread smaller than what independent samples would have.
  CHECK(spread < claimed * 1.3);
  CHECK(spread > claimed * 0.02);
}

TEST_CASE("path: light through a slab of glass has Fresnel's share, displaced by Snell") {
  // Twice through interfaces at 45 degrees, internal reflections included.
  TestScene scene;
  const u32 mesh = scene.add(rectangle(50, 50));
  MaterialView glass = standard_material();
  glass.constant.base_color = vec3(1);
  glass.constant.roughness = 0;
  glass.constant.transmission = 1;
  const u32 m = scene.add(glass);
  scene.add_instance(mesh, m, pose(mat3(1), {0, 0, 1}));
  scene.add_instance(mesh, m, pose(rotation({1, 0, 0}, kPi), {0, 0, 0}));
  // Light from below only: what is not reflected passes.
  std::vector<float> texels(size_t(4) * 2 * 3, 0);
  for (size_t i = 12; i < 24; ++i) texels[i] = 1;
  const u32 picture = scene.add_texture(texels, {4, 2}, TexelType::kF32);
  scene.set_dome(vec3(1), picture);
  scene.textures[picture].nearest = true;
  const SceneView& view = scene.finish();
  const CameraView camera = look_at({5, 0, 6}, {0, 0, 1}, {2, 2}, 0.001f);
  const vec3 got = mean_beauty(view, camera, standard_settings(40), 4096);
  const double f = fresnel_dielectric(std::sqrt(0.5f), 1.5f).reflectance;
  CHECK(got.y == Approx((1 - f) * (1 - f) / (1 - f * f)).epsilon(0.003));

  const TestTracer tracer(view);
  const Ray ray{vec3(0, 0, 2), normalize(vec3(1, 0, -1)), INFINITY, 0, {}};
  const Hit hit = tracer.closest(ray, kAllRays);
  const Surface s = surface_at(view, hit.instance, hit.primitive, {hit.u, hit.v}, 0);
  const Bsdf bsdf = make_bsdf(glass.constant, {-ray.direction, s.ng, s.ns});
  BsdfSample inside;
  REQUIRE(sample_bsdf(bsdf, 0.9f, vec2(0), inside));
  CHECK(inside.wi.x == Approx(std::sqrt(0.5) / 1.5));
}

TEST_CASE("path: cut-outs and partial opacity, for what is seen and for shadows") {
  for (const AlphaMode mode : {AlphaMode::kMask, AlphaMode::kBlend}) {
    TestScene scene;
    scene.add_instance(scene.add(rectangle(50, 50)), scene.add(lambert(vec3(0.5f))));
    // A checker of alpha 0.2 and 0.9 above the floor, 40 x 40 fields.
    std::vector<float> texels(size_t(40) * 40);
    for (u32 i = 0; i < 1600; ++i) texels[i] = (i % 40 + i / 40) % 2 ? 0.2f : 0.9f;
    const u32 texture = scene.add_texture(texels, {40, 40}, TexelType::kF32);
    scene.textures[texture].nearest = true;
    MaterialView m = lambert(vec3(0));
    m.alpha_mode = mode;
    m.textured = kAlphaBit;
    m.first_use = 0;
    scene.texture_uses.push_back(no_texture());
    scene.texture_uses[0].texture = texture;
    scene.texture_uses[0].uv_x = {200, 0};
    scene.texture_uses[0].uv_y = {0, 200};
    scene.add_instance(scene.add(rectangle(50, 50)), scene.add(m), pose(mat3(1), {0, 0, 0.2f}));
    scene.set_dome(vec3(1));
    const SceneView& view = scene.finish();
    CHECK(view.any_holes);
    // The camera sits below the screen: only shadows count.
    const CameraView camera = look_at({0, 0, 0.1f}, {0.01f, 0.02f, 0}, {8, 8}, 1);
    const float open = mode == AlphaMode::kMask ? 0.5f : 0.45f;
    const vec3 got = mean_beauty(view, camera, standard_settings(2), 1024);
    CHECK(got.y == Approx(0.5f * open).epsilon(0.02));
    // From above the screen's openness counts once more.
    const CameraView above = look_at({0, 0, 30}, {0, 0, 0}, {16, 16}, 1.0f);
    const vec3 twice = mean_beauty(view, above, standard_settings(2), 512);
    CHECK(twice.y == Approx(0.5f * open * open).epsilon(0.03));
  }
}

TEST_CASE("path: a normal map that tilts, and a height that climbs, is a tilted plane") {
  const float tilt = 0.3f;
  enum { kTurned, kMapped, kBumped };
  float results[3];
  for (const int way : {kTurned, kMapped, kBumped}) {
    TestScene scene;
    MaterialView m = plastic(0.3f);
    mat3 linear(1);
    if (way == kMapped) {
      const vec3 n = vec3(std::sin(tilt), 0, std::cos(tilt)) * 0.5f + 0.5f;
      m.normal_map = no_texture();
      m.normal_map.texture =
          scene.add_texture(std::vector<float>{n.x, n.y, n.z}, {1, 1}, TexelType::kF32);
    } else if (way == kBumped) {
      std::vector<float> ramp(64);
      for (u32 i = 0; i < 64; ++i) ramp[i] = (float(i) + 0.5f) / 64;  // u, which is 2 m wide
      m.bump_map.texture = scene.add_texture(ramp, {64, 1}, TexelType::kF32);
      m.bump_map.scale = -2 * std::tan(tilt);
    } else {
      linear = rotation({0, 1, 0}, tilt);
    }
    scene.add_instance(scene.add(rectangle(1, 1)), scene.add(m), pose(linear, {0, 0, 0}));
    const u32 lamp = scene.add_instance(scene.add(sphere(16)), scene.add(emitter(vec3(10))),
                                        pose(mat3(0.5f), {1, 1, 3}));
    scene.add_light(lamp);
    const SceneView& view = scene.finish();
    const CameraView camera = look_at({2, -1, 2}, {0, 0, 0}, {4, 4}, 0.01f);
    results[way] = mean_beauty(view, camera, standard_settings(2), 1024).y;
  }
  CHECK(results[kMapped] == Approx(results[kTurned]).epsilon(0.01));
  CHECK(results[kBumped] == Approx(results[kTurned]).epsilon(0.01));
}

TEST_CASE("path: alpha, coverage, cost, openness and guides") {
  TestScene scene;
  scene.add_instance(scene.add(rectangle(1, 1)), scene.add(lambert(vec3(0.2f, 0.4f, 0.6f))),
                     pose(mat3(1), {-1, 0, 0}));
  scene.set_dome(vec3(1, 2, 3));
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  const CameraView camera = look_at({0, 0, 5}, {0, 0, 0}, {2, 1}, 0.2f);
  for (const bool transparent : {false, true}) {
    Settings settings = standard_settings(3);
    settings.transparent_background = transparent;
    const TestFilm film({2, 1}, planes_of(Fold::kMean));
    render_pixel(view, camera, settings, tracer, film.view, 0, 0, 0, 64);
    render_pixel(view, camera, settings, tracer, film.view, 1, 0, 0, 64);
    const auto mean = [&](Plane plane, u64 i) { return film.mean(plane, i, 64); };
    CHECK(mean(Plane::BEAUTY, 3) == 1);
    CHECK(mean(Plane::BEAUTY, 7) == (transparent ? 0 : 1));
    CHECK(mean(Plane::BEAUTY, 5) == (transparent ? 0 : 2));
    CHECK(mean(Plane::ENVIRONMENT_LIGHT, 4) == (transparent ? 0 : 2));
    CHECK(mean(Plane::COVERAGE, 0) == 1);
    CHECK(mean(Plane::COVERAGE, 1) == 0);
    CHECK(mean(Plane::AMBIENT_OCCLUSION, 0) == 1);
    CHECK(mean(Plane::AMBIENT_OCCLUSION, 1) == 1);
    CHECK(mean(Plane::COST, 1) == 1);
    // To the plane, its openness, the dome, onwards.
    CHECK(mean(Plane::COST, 0) == 4);
    CHECK(mean(Plane::ALBEDO_MEAN, 2) == Approx(0.6f));
    CHECK(mean(Plane::DIFFUSE_COLOR, 2) == Approx(0.6f));
    CHECK(mean(Plane::DIFFUSE_COLOR, 3) == 0);
    CHECK(mean(Plane::NORMAL_MEAN, 2) == Approx(1));
    CHECK(mean(Plane::ALBEDO_MEAN, 5) == 0);
    CHECK(mean(Plane::DIRECT_DIFFUSE, 1) == Approx(0.8f).epsilon(0.01));
  }
}

TEST_CASE("path: guides are carried through mirrors and glass") {
  TestScene scene;
  MaterialView mirror = plastic(0, 1);
  mirror.constant.base_color = vec3(0.9f);
  scene.add_instance(scene.add(rectangle(1, 1)), scene.add(mirror));
  scene.add_instance(scene.add(rectangle(20, 20)), scene.add(lambert(vec3(0.2f, 0.4f, 0.6f))),
                     pose(rotation({1, 0, 0}, kPi), {0, 0, 9}));
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  const CameraView camera = look_at({0, 0, 5}, {0, 0, 0}, {1, 1}, 0.05f);
  const TestFilm film({1, 1}, kGuidePlaneSet);
  render_pixel(view, camera, standard_settings(2), tracer, film.view, 0, 0, 0, 16);
  CHECK(film.mean(Plane::ALBEDO_MEAN, 2, 16) == Approx(0.54f).epsilon(1e-3));
  CHECK(film.mean(Plane::NORMAL_MEAN, 2, 16) == Approx(-1));
}

TEST_CASE("path: which rays meet an entity") {
  // A black screen hides the lamp from the floor, unless shadow and diffuse rays pass it.
  for (const u32 visibility : {u32(kAllRays), u32(kAllRays & ~kShadowRay & ~kDiffuseRay)}) {
    TestScene scene;
    scene.add_instance(scene.add(rectangle(1, 1)), scene.add(lambert(vec3(1))));
    const u32 screen = scene.add_instance(scene.add(rectangle(9, 9)), scene.add(lambert(vec3(0))),
                                          pose(mat3(1), {0, 0, 1}));
    scene.instances[screen].visibility = visibility & ~kCameraRay;
    const u32 lamp = scene.add_instance(scene.add(sphere(12)), scene.add(emitter(vec3(1))),
                                        pose(mat3(1), {0, 0, 4}));
    scene.add_light(lamp);
    const SceneView& view = scene.finish();
    const CameraView camera = look_at({0, -2, 2}, {0, 0, 0}, {4, 4}, 0.1f);
    const float got = mean_beauty(view, camera, standard_settings(2), 64).y;
    CHECK((got > 0) == (visibility != kAllRays));
  }
  // A lamp that glossy rays do not meet lights the diffuse part alone, by any strategy.
  float results[2];
  for (const bool visible : {false, true}) {
    TestScene scene;
    scene.add_instance(scene.add(rectangle(1, 1)), scene.add(lambert(vec3(0.5f))));
    const u32 lamp = scene.add_instance(scene.add(sphere(16)), scene.add(emitter(vec3(1))),
                                        pose(mat3(1), {0, 0, 2}));
    if (!visible) scene.instances[lamp].visibility = kAllRays & ~kGlossyRay & ~kCameraRay;
    scene.add_light(lamp);
    const SceneView& view = scene.finish();
    const CameraView camera = look_at({2, -2, 1}, {0, 0, 0}, {4, 4}, 0.1f);
    results[visible] = mean_beauty(view, camera, standard_settings(2), 2048).y;
  }
  CHECK(results[0] == Approx(results[1]).epsilon(0.01));
}

TEST_CASE("path: unlit surfaces show their colour on both sides and scatter nothing") {
  TestScene scene;
  MaterialView m = standard_material();
  m.unlit = true;
  m.constant.base_color = vec3(0.2f, 0.5f, 0.7f);
  scene.add_instance(scene.add(rectangle(1, 1)), scene.add(m));
  scene.set_dome(vec3(5));
  const SceneView& view = scene.finish();
  for (const float z : {3.0f, -3.0f}) {
    const CameraView camera = look_at({0, 0, z}, {0, 0, 0}, {1, 1}, 0.1f);
    CHECK(mean_beauty(view, camera, standard_settings(5), 16).y == 0.5f);
  }
}

TEST_CASE("path: no surface shadows itself, far from the origin or on large triangles") {
  std::mt19937 engine(1);
  std::uniform_real_distribution<float> unit(-1, 1);
  for (const float away : {0.0f, 10.0f, 1000.0f}) {
    for (const float size : {0.1f, 10.0f, 1000.0f}) {
      TestScene scene;
      const u32 mesh = scene.add(sphere(16));
      const u32 m = scene.add(lambert(vec3(1)));
      const vec3 center = vec3(unit(engine), unit(engine), unit(engine)) * away;
      scene.add_instance(mesh, m, pose(rotation({1, 2, 3}, 1) * size, center));
      scene.set_dome(vec3(1));
      const SceneView& view = scene.finish();
      const CameraView camera = look_at(center + vec3(4 * size, 0, 0), center, {8, 8}, 0.2f);
      INFO("away " << away << " size " << size);
      // White under a uniform sky: any self-shadow darkens. Tiny and far away, float runs out.
      if (away / size > 5000) continue;
      CHECK(mean_beauty(view, camera, standard_settings(2), 64).y == Approx(1).epsilon(0.01));
    }
  }
}
