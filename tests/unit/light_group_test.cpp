// Light groups: their sum is the beauty, and scaled they are what scaled lights would show.
#include "kernels/schedule/scalar.h"
#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

constexpr uvec2 kSize{12, 9};
constexpr u32 kSamples = 40;  // two blocks and a half
constexpr u32 kGroups = 5;

/// A lamp, a glowing textured sheet, an unlit sign, a sun and a sky over a floor and a mirror.
struct Studio {
  TestScene scene;
  Studio() {
    MaterialView mirror = standard_material();
    mirror.constant.metallic = 1;
    mirror.constant.roughness = 0.2f;
    MaterialView sign = standard_material();
    sign.unlit = true;
    sign.constant.base_color = vec3(0.3f, 0.1f, 0.6f);
    const u32 square = scene.add(rectangle(1, 1));
    const u32 floor = scene.add_instance(scene.add(rectangle(9, 9)), scene.add(mirror));
    const mat3 down = rotation({1, 0, 0}, kPi);
    const u32 lamp =
        scene.add_instance(square, scene.add(emitter(vec3(5, 4, 3))), pose(down, {1, 0, 2}));
    const u32 sheet =
        scene.add_instance(square, scene.add(emitter(vec3(1, 2, 3))), pose(down, {-1, 0, 1}));
    const u32 board = scene.add_instance(square, scene.add(sign), pose(mat3(1), {0, 1, 0.4f}));
    scene.add_light(lamp);
    scene.add_light(sheet);
    scene.suns.push_back({.direction = normalize(vec3(1, 2, 3)),
                          .one_minus_cos = 0.02f,
                          .radiance = vec3(30, 20, 10),
                          .visibility = kAllRays,
                          .light_group = 3});
    scene.set_dome(vec3(0.2f, 0.3f, 0.5f));
    scene.view.dome.light_group = 4;
    scene.instances[floor].light_group = 0;
    scene.instances[lamp].light_group = 1;
    scene.instances[sheet].light_group = 2;
    scene.instances[board].light_group = 3;
    scene.finish();
  }
  /// Multiplies all light of a group, and leaves how lights are chosen as it is.
  void scale(const float (&factor)[kGroups]) {
    for (const u32 lamp : {1u, 2u}) {
      const u32 i = scene.lights[lamp - 1].instance;
      scene.materials[scene.view.part_materials[scene.instances[i].first_part]].constant.emission *=
          factor[lamp];
    }
    scene.materials[scene.view.part_materials[scene.instances[3].first_part]].constant.base_color *=
        factor[3];
    scene.suns[0].radiance *= factor[3];
    scene.view.dome.radiance *= factor[4];
  }
  void render(const TestFilm& film, float clamp = INFINITY) const {
    const TestTracer tracer(scene.view);
    const CameraView camera = look_at({0, -4, 2}, {0, 0, 0.5f}, kSize, 0.9f);
    Settings settings = standard_settings(6);
    settings.clamp = clamp;
    for (u32 y = 0; y < kSize.y; ++y)
      for (u32 x = 0; x < kSize.x; ++x)
        render_pixel(scene.view, camera, settings, tracer, film.view, x, y, 0, kSamples);
  }
};

constexpr PlaneSet kPlanesOfGroups = kBeauty | plane_bit(Plane::BEAUTY_GROUP);

float group_value(const TestFilm& film, u32 rank, u64 pixel, u32 channel) {
  const u64 i = (u64(rank) * kSize.x * kSize.y + pixel) * 3 + channel;
  return film.mean(Plane::BEAUTY_GROUP, i, kSamples);
}

}  // namespace

TEST_CASE("light groups: they sum to the beauty, with and without a clamp") {
  const Studio studio;
  for (const float clamp : {INFINITY, 0.5f}) {
    const TestFilm film(kSize, kPlanesOfGroups, {0, 1, 2, 3, 4});
    studio.render(film, clamp);
    u32 lit[kGroups] = {};
    for (u64 pixel = 0; pixel < u64(kSize.x) * kSize.y; ++pixel) {
      for (u32 c = 0; c < 3; ++c) {
        float sum = 0;
        for (u32 rank = 0; rank < kGroups; ++rank) {
          const float value = group_value(film, rank, pixel, c);
          lit[rank] += value > 0;
          sum += value;
        }
        CHECK(sum == Approx(film.mean(Plane::BEAUTY, pixel * 4 + c, kSamples)).epsilon(1e-5));
      }
    }
    CHECK(lit[0] == 0);
    for (u32 rank = 1; rank < kGroups; ++rank) CHECK(lit[rank] > 50);
  }
}

TEST_CASE("light groups: scaled and summed they are the picture of scaled lights") {
  const float factor[kGroups] = {1, 2, 0.25f, 7, 0};
  const TestFilm before(kSize, kPlanesOfGroups, {0, 1, 2, 3, 4});
  Studio studio;
  studio.render(before);
  studio.scale(factor);
  const TestFilm after(kSize, kBeauty);
  studio.render(after);
  for (u64 pixel = 0; pixel < u64(kSize.x) * kSize.y; ++pixel) {
    for (u32 c = 0; c < 3; ++c) {
      float sum = 0;
      for (u32 rank = 0; rank < kGroups; ++rank)
        sum += factor[rank] * group_value(before, rank, pixel, c);
      CHECK(sum == Approx(after.mean(Plane::BEAUTY, pixel * 4 + c, kSamples)).epsilon(1e-5));
    }
  }
}

TEST_CASE("light groups: one that is asked for alone is the same; it changes no other plane") {
  const Studio studio;
  const TestFilm all(kSize, kPlanesOfGroups, {0, 1, 2, 3, 4});
  const TestFilm some(kSize, kPlanesOfGroups, {kNone, kNone, 1, kNone, 0});
  const TestFilm none(kSize, kBeauty);
  studio.render(all);
  studio.render(some);
  studio.render(none);
  for (u64 pixel = 0; pixel < u64(kSize.x) * kSize.y; ++pixel) {
    for (u32 c = 0; c < 3; ++c) {
      CHECK(group_value(some, 0, pixel, c) == group_value(all, 4, pixel, c));
      CHECK(group_value(some, 1, pixel, c) == group_value(all, 2, pixel, c));
      CHECK(all.mean(Plane::BEAUTY, pixel * 4 + c, kSamples) ==
            none.mean(Plane::BEAUTY, pixel * 4 + c, kSamples));
    }
  }
}
