// Paths in lockstep against the loop over pixels: the same bytes.
#include "kernels/schedule/lockstep.h"

#include <array>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "tests/unit/any_material.h"
#include "tests/unit/catch.h"
#include "tests/unit/path_room.h"

using namespace heliograph::test;

namespace {

using Company = std::vector<std::array<float, 3>>;

/// Notes which camera rays come together.
struct NotingTracer {
  const TestTracer& tracer;
  std::set<Company>& companies;

  [[nodiscard]] Hit closest(const Ray& ray, u32 mask) const { return tracer.closest(ray, mask); }
  [[nodiscard]] bool occluded(const Ray& ray, u32 mask) const { return tracer.occluded(ray, mask); }
  [[nodiscard]] Hit closest_in(u32 instance, const Ray& ray) const {
    return tracer.closest_in(instance, ray);
  }
  void closest(const CameraRays& rays) const {
    Company company;
    for (u32 i = 0; i < rays.count; ++i) {
      const vec3 d = rays.ray[i]->direction;
      company.push_back({d.x, d.y, d.z});
      *rays.hit[i] = tracer.closest(*rays.ray[i], kCameraRay);
    }
    companies.insert(company);
  }
};

/// Counts rays, but for those of the camera.
struct CountingTracer : TestTracer {
  u64& count;

  CountingTracer(const SceneView& scene, u64& n) : TestTracer(scene), count(n) {}
  [[nodiscard]] Hit closest(const Ray& ray, u32 mask) const {
    ++count;
    return TestTracer::closest(ray, mask);
  }
  [[nodiscard]] bool occluded(const Ray& ray, u32 mask) const {
    ++count;
    return TestTracer::occluded(ray, mask);
  }
};

/// The companies of a rectangle's camera rays.
std::set<Company> companies_of(const SceneView& scene, std::span<const PixelRect> rects,
                               std::span<const std::pair<u32, u32>> ranges) {
  std::set<Company> companies;
  const TestFilm film(kSize, kBeauty);
  const ShotView shot = shot_of(scene, 7, film);
  const TestTracer tracer(scene);
  for (const auto& [first, samples] : ranges)
    for (const PixelRect& rect : rects)
      render_rect(shot.scene, shot.camera, shot.settings, NotingTracer{tracer, companies},
                  film.view, rect, first, samples);
  return companies;
}

/// Spheres of every material on a floor, under even spheres that emit and an even sky.
void furnish_plainly(TestScene& scene, u32 lamps, bool sky = true) {
  MaterialView floor = plastic(0.4f);
  floor.constant.specular_tint = 0.5f;
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(floor), pose(mat3(1), {0, 0, -1}));
  std::vector<MaterialView> materials(8, plastic(0.3f));
  materials[0].constant.metallic = 1;
  materials[1].constant.metallic = 0.5f;
  materials[2] = lambert(vec3(0.2f, 0.7f, 0.9f));
  materials[3].constant.roughness = 0;
  materials[4] = lambert(vec3(0));
  materials[5].unlit = true;
  materials[6].constant.clearcoat = 1;
  materials[7] = plastic(0.2f, 1);
  for (u32 i = 0; i < materials.size(); ++i) {
    const u32 row = i / 4;
    const vec3 place(float(i % 4) * 0.8f - 1.2f, float(row) * 1.1f - 0.5f, -0.6f);
    scene.add_instance(scene.add(sphere(12)), scene.add(materials[i]), pose(mat3(0.4f), place));
  }
  for (u32 i = 0; i < lamps; ++i) {
    const vec3 place(float(i) - 1, 1 - float(i % 2), 1.5f + 0.3f * float(i));
    const mat3 turned = rotation({1, 2, 3}, float(i)) * mat3(0.2f + 0.1f * float(i));
    scene.add_light(scene.add_instance(scene.add(unit_shape(Shape::kSphere)),
                                       scene.add(emitter(vec3(0))), pose(turned, place)),
                    0, vec3(8, 6, 4 + i));
  }
  if (sky) scene.set_dome(vec3(0.1f, 0.2f, 0.3f));
}

/// Renders a scene both ways, in lockstep by rectangles and ranges of samples.
void check_same(const SceneView& scene, PlaneSet wanted, const Settings* settings = nullptr) {
  const TestFilm loop(kSize, wanted), lockstep(kSize, wanted);
  const TestTracer tracer(scene);
  ShotView shot = shot_of(scene, 7, loop);
  if (settings) shot.settings = *settings;
  u64 rays = run_loop({shot, tracer}, loop);
  for (const auto& [first, samples] : {std::pair{0u, 3u}, std::pair{3u, kSamples - 3}}) {
    for (const PixelRect& rect :
         {PixelRect{0, 0, 7, 5}, PixelRect{7, 0, kSize.x, 5}, PixelRect{0, 5, kSize.x, kSize.y}}) {
      rays -= render_rect(shot.scene, shot.camera, shot.settings, tracer, lockstep.view, rect,
                          first, samples);
    }
  }
  CHECK(rays == 0);
  for (u32 plane = 0; plane < kPlanes; ++plane) {
    if (!(wanted >> plane & 1)) continue;
    INFO(plane);
    CHECK(different_means(loop, lockstep, Plane(plane), kSamples) == 0);
  }
}

}  // namespace

TEST_CASE("lockstep: its film is that of the loop over pixels") {
  TestScene scene;
  const SceneView& view = furnish(scene, false);
  check_same(view, kBeauty);
  check_same(view, kEverything);
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: media keep to their paths") {
  TestScene scene;
  const SceneView& view = furnish(scene, true);
  REQUIRE(view.any_media);
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: plain surfaces side by side, of every kind, among others") {
  TestScene scene;
  furnish_plainly(scene, 3);
  const SceneView& view = scene.finish();
  REQUIRE(has_plain_lights(view));
  REQUIRE(is_plain(shot_of(view, 7, TestFilm(kSize, kBeauty)).camera));
  check_same(view, kBeauty);
  check_same(view, kEverything);
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: one lamp, or none, with and without a sky") {
  for (const u32 lamps : {0u, 1u, 2u}) {
    TestScene scene;
    furnish_plainly(scene, lamps, lamps != 1);
    const SceneView& view = scene.finish();
    REQUIRE(has_plain_lights(view));
    check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
  }
}

TEST_CASE("lockstep: a dome's picture, with lamps and without, with a guide and without") {
  const auto [lamps, guided] =
      GENERATE(std::pair{0u, true}, std::pair{2u, true}, std::pair{2u, false});
  Random random;
  std::vector<float> texels;
  for (u32 i = 0; i < 3 * 48 * 24; ++i)
    texels.push_back(random.next() < 0.02f ? 30 : random.next());
  TestScene scene;
  furnish_plainly(scene, lamps, false);
  scene.dome_rotation = rotation({1, 1, 0}, 0.6f);
  scene.set_dome(vec3(0.3f), scene.add_texture(texels, {48, 24}, TexelType::kF32));
  SceneView view = scene.finish();
  if (!guided) view.dome.guides = nullptr;
  REQUIRE(has_plain_lights(view));
  check_same(view, kBeauty);
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: flat lights, near and far, of up to four triangles, among spheres") {
  const u32 spheres = GENERATE(0u, 2u);
  TestScene scene;
  furnish_plainly(scene, spheres, spheres > 0);
  const u32 black = scene.add(emitter(vec3(0)));
  const auto add = [&](const TestMesh& mesh, const mat4x3& pose, vec3 radiance) -> LightView& {
    return scene.add_light(scene.add_instance(scene.add(mesh), black, pose), 0, radiance);
  };
  TestMesh tent = rectangle(0.3f, 0.2f);
  for (const uvec3 t : {uvec3(0, 1, 2), uvec3(2, 1, 3)}) tent.triangles.push_back(t);
  tent.positions[0].z = 0.2f;
  TestMesh corner = rectangle(0.1f, 0.1f);
  corner.triangles.resize(1);
  const mat3 down = rotation({1, 0, 0}, 3), aside = rotation({1, 1, 0}, 2);
  const mat3 uneven(vec3(2, 0, 0), vec3(0, 0.3f, 0), vec3(0, 0, 1));
  add(rectangle(1.5f, 1), pose(down, {0, 0, 1.2f}), vec3(1, 2, 3));
  add(tent, pose(down * uneven, {0.5f, 0.5f, 0.3f}), vec3(5, 1, 2)).light_two_sided = true;
  add(corner, pose(aside, {-1, 0.2f, 0.8f}), vec3(40, 30, 20));
  add(rectangle(0.2f, 0.2f), pose(-aside, {1, -1, 1}), vec3(9));
  const SceneView& view = scene.finish();
  REQUIRE(has_plain_lights(view));
  REQUIRE(view.lights[spheres].flat != kNone);
  check_same(view, kBeauty);
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: last rays are traced where they may meet light") {
  const bool sky = GENERATE(false, true);
  const u32 lamps = GENERATE(0u, 1u, 12u);
  TestScene scene;
  scene.add_instance(scene.add(block({4, 4, 4})), scene.add(plastic(0.4f)));
  scene.add_instance(scene.add(sphere(12)), scene.add(plastic(0.1f, 1)), pose(mat3(0.5f), {}));
  for (u32 i = 0; i < lamps; ++i) {
    const u32 row = i / 4;
    const vec3 place(float(i % 4) - 1.5f, float(row) - 1, 1.5f);
    scene.add_light(
        scene.add_instance(scene.add(rectangle(0.1f, 0.1f)), scene.add(emitter(vec3(0))),
                           pose(rotation({1, 0, 0}, 3.1f), place)),
        0, vec3(8, 6, 4));
  }
  if (sky) scene.set_dome(vec3(0.5f));
  const SceneView& view = scene.finish();
  const TestFilm film(kSize, kBeauty);
  ShotView shot = shot_of(view, 7, film);
  shot.settings.max_depth = 3;
  shot.settings.roulette_depth = 8;
  check_same(view, kBeauty, &shot.settings);
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP), &shot.settings);
  if (sky) return;
  u64 traced = 0;
  const u64 rays = render_rect(shot.scene, shot.camera, shot.settings, CountingTracer(view, traced),
                               film.view, {0, 0, kSize.x, kSize.y}, 0, kSamples);
  CHECK(traced < rays - rays / 8);
}

TEST_CASE("lockstep: surfaces of every material, side by side") {
  Random random(GENERATE(1u, 2u, 3u, 4u));
  TestScene scene;
  furnish_plainly(scene, 2);
  for (u32 i = 0; i < 20; ++i) {
    const u32 row = i / 5;
    const vec3 place(float(i % 5) * 0.6f - 1.3f, float(row) * 0.6f - 1, 0.1f);
    scene.add_instance(scene.add(sphere(6)), scene.add(any_material(random)),
                       pose(mat3(0.25f), place));
  }
  constexpr CasterView casters[] = {{.center = {-1.2f, -0.5f, -0.6f}, .radius = 0.4f, .mirror = 1}};
  SceneView view = scene.finish();
  check_same(view, kBeauty);
  view.casters = casters;
  view.caster_count = 1;
  view.caster_probability = 0.5f;
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: lamps that are no even spheres are sampled one by one") {
  TestScene scene;
  furnish_plainly(scene, 2);
  SECTION("a sun") {
    scene.suns.push_back({});
    scene.suns.back().direction = normalize(vec3(1, 1, 2));
    scene.suns.back().one_minus_cos = 0.01f;
    scene.suns.back().radiance = vec3(50);
    scene.suns.back().visibility = kAllRays & ~kGlossyRay;
  }
  SECTION("a spot") {
    scene.lights[0].cone_cos = 0.5f;
    scene.lights[0].cone_scale = 4;
  }
  SECTION("from both sides") { scene.lights[1].light_two_sided = true; }
  SECTION("that is hidden from diffuse rays") {
    scene.instances[scene.lights[1].instance].visibility = kAllRays & ~kDiffuseRay;
  }
  const SceneView& view = scene.finish();
  REQUIRE_FALSE(has_plain_lights(view));
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: plain surfaces look for what focuses light") {
  constexpr CasterView casters[] = {
      {.center = {-1.2f, -0.5f, -0.6f}, .radius = 0.4f, .mirror = 1},
      {{1.2f, 0.6f, -0.6f}, 0.4f},
      {.center = {0.4f, 0.6f, 0.2f}, .radius = 0.5f, .mirror = 0.25f}};
  constexpr CastLightView lamps[] = {{{-1, 1, 1.5f}, 0.2f}, {{0, 0, 1.8f}, 0.3f}};
  TestScene scene;
  furnish_plainly(scene, 2);
  SceneView view = scene.finish();
  view.casters = casters;
  view.caster_count = 3;
  view.cast_lights = lamps;
  view.cast_light_count = 2;
  for (const float probability : {0.2f, 0.9f, 0.0f}) {
    view.caster_probability = probability;
    check_same(view, kEverything);
    check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
  }
}

TEST_CASE("lockstep: plain surfaces under tinted glass, and behind what light passes") {
  TestScene scene;
  furnish_plainly(scene, 2);
  MaterialView tinted = plastic(0, 1);
  tinted.constant.attenuation_distance = 0.5f;
  tinted.constant.attenuation_color = vec3(0.9f, 0.4f, 0.2f);
  SECTION("glass") {}
  SECTION("a boundary") { tinted.constant.ior = 1; }
  scene.add_instance(scene.add(sphere(12)), scene.add(tinted), pose(mat3(0.5f), {0.2f, 0, 0.4f}));
  const SceneView& view = scene.finish();
  REQUIRE(view.any_media);
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: cameras that blur, move, bend or clip") {
  TestScene scene;
  furnish_plainly(scene, 2);
  const SceneView& view = scene.finish();
  const auto same = [&](auto change) {
    const TestFilm loop(kSize, kBeauty), lockstep(kSize, kBeauty);
    const TestTracer tracer(view);
    ShotView shot = shot_of(view, 7, loop);
    change(shot);
    run_loop({shot, tracer}, loop);
    render_rect(shot.scene, shot.camera, shot.settings, tracer, lockstep.view,
                {0, 0, kSize.x, kSize.y}, 0, kSamples);
    CHECK(different_means(loop, lockstep, Plane::BEAUTY, kSamples) == 0);
  };
  same([](ShotView& s) { s.camera.aperture = {0.2f, 4, 0, 0}; });
  same([](ShotView& s) { s.camera.shutter = {0, 0.5f, 0.01f}; });
  same([](ShotView& s) { s.camera.shutter = {0, 0, 0.01f}; });
  same([](ShotView& s) { s.camera.lens.projection = Projection::kOrthographic; });
  same([](ShotView& s) { s.camera.near = 2, s.camera.far = 5; });
  for (const auto filter : {PixelFilter::kBox, PixelFilter::kTent, PixelFilter::kGaussian})
    same([&](ShotView& s) { s.settings.filter = filter; });
}

TEST_CASE("lockstep: pictures of any size, from one pixel on, are crops of a larger one") {
  TestScene scene;
  furnish_plainly(scene, 2);
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  for (const auto filter : {PixelFilter::kBox, PixelFilter::kTent, PixelFilter::kGaussian,
                            PixelFilter::kBlackmanHarris}) {
    const TestFilm large(kSize, kBeauty);
    ShotView shot = shot_of(view, 7, large);
    shot.settings.filter = filter;
    run_loop({shot, tracer}, large);
    for (const uvec2 size : {uvec2(1, 1), uvec2(2, 1), uvec2(3, 3), uvec2(1, kSize.y),
                             uvec2(3, kSize.y), uvec2(kSize.x, 1), uvec2(5, 2), uvec2(17, 17)}) {
      const TestFilm small(size, kBeauty);
      render_rect(view, shot.camera, shot.settings, tracer, small.view, {0, 0, size.x, size.y}, 0,
                  kSamples);
      u32 different = 0;
      for (u32 y = 0; y < size.y; ++y)
        for (u32 i = 0; i < 4 * size.x; ++i)
          different += small.mean(Plane::BEAUTY, 4 * u64(y) * size.x + i, kSamples) !=
                       large.mean(Plane::BEAUTY, 4 * u64(y) * kSize.x + i, kSamples);
      INFO(u32(filter) << ": " << size.x << " x " << size.y);
      CHECK(different == 0);
    }
  }
}

TEST_CASE("lockstep: however work is cut, the same camera rays are traced together") {
  TestScene scene;
  const SceneView& view = furnish(scene, false);
  const PixelRect whole{0, 0, kSize.x, kSize.y};
  const u32 x = kPatchWidth, y = 2 * kPatchHeight;
  const PixelRect cut[]{{0, 0, x, y}, {x, 0, kSize.x, y}, {0, y, kSize.x, kSize.y}};
  const std::pair<u32, u32> all{0, 5}, some[]{{0, 1}, {1, 4}};
  const auto companies = companies_of(view, {&whole, 1}, {&all, 1});
  CHECK(companies.size() > kSize.x * kSize.y * 5 / kPatchPixels / 2);
  CHECK(companies == companies_of(view, cut, {&all, 1}));
  CHECK(companies == companies_of(view, {&whole, 1}, some));
}
