// Plain programs against the others: the same bytes of what is_plain() says that they render.
#include <utility>

#include "kernels/schedule/wave.h"
#include "tests/unit/catch.h"
#include "tests/unit/plain_pixels.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

constexpr uvec2 kSize{32, 24};
constexpr u32 kSamples = 20;
constexpr PlaneSet kWanted =
    kBeauty | kGuidePlaneSet | plane_bit(Plane::COVERAGE) | plane_bit(Plane::COST);

MaterialView painted(vec3 color, float roughness) {
  MaterialView m = standard_material();
  m.constant.base_color = color;
  m.constant.roughness = roughness;
  return m;
}

/// A ball of glass and one of metal on a glossy floor, a lamp and a sky.
const SceneView& furnish(TestScene& scene) {
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(painted(vec3(0.6f, 0.5f, 0.4f), 0.2f)),
                     pose(mat3(1), {0, 0, -1}));
  MaterialView metal = painted(vec3(0.9f, 0.7f, 0.3f), 0.25f);
  metal.constant.metallic = 1;
  scene.add_instance(scene.add(sphere(16)), scene.add(metal));
  MaterialView glass = painted(vec3(1), 0);
  glass.constant.transmission = 1;
  scene.add_instance(scene.add(sphere(16)), scene.add(glass), pose(mat3(1), {1.5f, -1, 0}));
  scene.add_light(scene.add_instance(scene.add(rectangle(1.5f, 1.5f)),
                                     scene.add(emitter(vec3(4, 5, 6))),
                                     pose(rotation({1, 0, 0}, kPi), {0.5f, 0.3f, 3})));
  scene.set_dome(vec3(0.4f, 0.5f, 0.6f));
  return scene.finish();
}

ShotView shot_of(const SceneView& scene, const FilmView& film) {
  Settings settings = standard_settings(5);
  settings.roulette_depth = 3;
  return {scene, look_at(vec3(3, -3, 2), {0, 0, -0.2f}, kSize, 0.8f), settings, film};
}

}  // namespace

TEST_CASE("plain: pictures have the same bytes, path by path and as a wave") {
  TestScene scene;
  const SceneView& view = furnish(scene);
  const PlaneSet wanted =
      GENERATE(as<PlaneSet>(), kWanted, kBeauty, kBeauty | plane_bit(Plane::COVERAGE));
  const TestFilm rich(kSize, wanted), plain(kSize, wanted), wave(kSize, wanted);
  ShotView shot = shot_of(view, rich.view);
  shot.settings.transparent_background = GENERATE(false, true);
  REQUIRE(is_plain(shot));
  const TestTracer tracer(view);
  u64 rays = 0;
  for (u32 y = 0; y < kSize.y; ++y)
    for (u32 x = 0; x < kSize.x; ++x)
      rays += render_pixel(view, shot.camera, shot.settings, tracer, rich.view, x, y, 0, kSamples);
  const RayAnswers answers{[&](const Ray& ray, u32 mask) { return tracer.closest(ray, mask); },
                           [&](const Ray& ray, u32 mask) { return tracer.occluded(ray, mask); }};
  CHECK(render_plain(view, shot.camera, shot.settings, answers, plain.view, kSamples) == rays);
  CHECK(render_plain_wave(view, shot.camera, shot.settings, answers, wave.view, kSamples) == rays);
  for (u32 plane = 0; plane < kPlanes; ++plane) {
    if (!(wanted >> plane & 1)) continue;
    INFO(plane);
    CHECK(different_means(rich, plain, Plane(plane), kSamples) == 0);
    CHECK(different_means(rich, wave, Plane(plane), kSamples) == 0);
  }
  u32 lit = 0;
  for (u32 i = 0; i < kSize.x * kSize.y; ++i)
    lit += rich.mean(Plane::BEAUTY, 4 * u64(i), kSamples) > 0;
  CHECK(lit > kSize.x * kSize.y / 4);
}

TEST_CASE("plain: whatever such programs leave out makes a shot rich") {
  TestScene scene;
  const ShotView shot = shot_of(furnish(scene), TestFilm(kSize, kWanted).view);
  SECTION("a material") {
    const auto value =
        GENERATE(&MaterialValues::subsurface, &MaterialValues::clearcoat, &MaterialValues::sheen,
                 &MaterialValues::iridescence, &MaterialValues::anisotropic);
    MaterialView m = painted(vec3(1), 0.3f);
    m.constant.*value = 0.5f;
    CHECK(is_rich(m));
  }
  SECTION("glass that is no joint interface") {
    MaterialView m = painted(vec3(1), 0.3f);
    m.constant.transmission = 0.5f;
    CHECK_FALSE(is_rich(m));
    m.thin_walled = true;
    CHECK(is_rich(m));
    m.thin_walled = false;
    m.constant.transmission_roughness = 0.1f;
    CHECK(is_rich(m));
  }
  SECTION("a scene") {
    ShotView other = shot;
    const auto flag = GENERATE(&SceneView::any_rich, &SceneView::any_media);
    other.scene.*flag = true;
    CHECK_FALSE(is_plain(other));
    other = shot;
    other.scene.volume_count = 1;
    CHECK_FALSE(is_plain(other));
  }
  SECTION("a film") {
    ShotView other = shot;
    const Plane plane = GENERATE(Plane::DIRECT_DIFFUSE, Plane::ENVIRONMENT_LIGHT,
                                 Plane::AMBIENT_OCCLUSION, Plane::BEAUTY_GROUP);
    other.film.wanted |= plane_bit(plane);
    CHECK_FALSE(is_plain(other));
    float caught = 0;
    other = shot;
    other.film.catcher = &caught;
    CHECK_FALSE(is_plain(other));
  }
}
