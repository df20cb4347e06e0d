// The CPU backend by its pictures: what is seen where, and that nothing but the scene decides it.
#include "renderer/schedule/engine.h"

#include <numeric>

#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

TEST_CASE("embree: depth of a plane seen from above") {
  auto engine = make_engine();
  const auto scene = Edits()
                         .mesh("quad", quad())
                         .object("floor", "quad", scaled(vec3(4), vec3(0)))
                         .camera("camera", look_at({0, 0, 3}, vec3(0)), 32, 32, 32)
                         .apply();
  const auto frame = render(*engine, job_of(scene, {Plane::DEPTH, Plane::INSTANCE}));
  for (const float z : pixels<float>(*frame)) CHECK(z == Approx(3).epsilon(1e-6));
  for (const u32 label : pixels<u32>(*frame, 1)) CHECK(label == pixels<u32>(*frame, 1)[0]);
  CHECK(pixels<u32>(*frame, 1)[0] != 0);
  CHECK(frame->k[0][0] == 32);
  CHECK(frame->k[2][0] == 15.5);
}

TEST_CASE("embree: an empty scene shows its sky, and nothing without one") {
  auto engine = make_engine();
  const auto dark = Edits().camera("camera", look_at({0, 0, 3}, vec3(0)), 8, 8, 8).apply();
  const auto nothing = render(*engine, job_of(dark, {Plane::DEPTH, Plane::BEAUTY}, 2));
  for (const float z : pixels<float>(*nothing)) CHECK(z == INFINITY);
  for (std::size_t i = 0; i < 64; ++i) CHECK(pixels<float>(*nothing, 1)[4 * i] == 0);
  const auto lit = Edits().dome(vec3(0.25f, 0.5f, 1)).apply(*dark);
  const auto sky = render(*engine, job_of(lit, {Plane::BEAUTY}, 2));
  for (std::size_t i = 0; i < 64; ++i) {
    CHECK(pixels<float>(*sky)[4 * i] == Approx(0.25f));
    CHECK(pixels<float>(*sky)[4 * i + 2] == Approx(1));
  }
}

TEST_CASE("embree: a white diffuse object in a white sky is white") {
  auto engine = make_engine();
  Edits edits;
  edits.mesh("sphere", sphere(32)).material("white", vec3(1)).dome(vec3(1));
  PutMaterial matte;
  matte.parameters[std::size_t(MaterialParameter::specular)].value = vec3(0);
  edits.put("white", matte)
      .object("ball", "sphere", mat4x3(1), "white")
      .camera("camera", look_at({0, -4, 0}, vec3(0)), 16, 16, 48);
  auto job = job_of(edits.apply(), {Plane::BEAUTY}, 64);
  job.settings.max_depth = 64;
  const auto frame = render(*engine, job);
  double mean = 0;
  for (std::size_t i = 0; i < 256; ++i) mean += double(pixels<float>(*frame)[4 * i + 1]) / 256;
  CHECK(mean == Approx(1).margin(0.01));
}

TEST_CASE("embree: the same bits with one thread, two, and any split of the work") {
  const auto scene = still_life().apply();
  const std::vector planes{Plane::BEAUTY, Plane::DEPTH, Plane::VARIANCE, Plane::COVERAGE};
  auto two = make_engine(2);
  const auto reference = render(*two, job_of(scene, planes, 21));
  SECTION("threads") {
    auto one = make_engine(1);
    CHECK(same_planes(*reference, *render(*one, job_of(scene, planes, 21))));
  }
  SECTION("slices") {
    auto fine = Engine::create({.device = {.threads = 2}, .slice = std::chrono::milliseconds(1)});
    REQUIRE(fine.has_value());
    CHECK(same_planes(*reference, *render(**fine, job_of(scene, planes, 21))));
  }
  SECTION("passes") {
    auto job = job_of(scene, planes, 21);
    job.progressive = true;
    CHECK(same_planes(*reference, *render(*two, job)));
  }
}

namespace {

/// All planes of a job whose work is done range by range, in slices that are over at once.
std::vector<PlaneData> planes_by_ranges(Backend& backend, const RenderJob& job,
                                        const std::vector<WorkRange>& ranges) {
  Shot shot{.job = std::make_shared<const RenderJob>(job)};
  const SceneAt at{job.snapshot, {job.time, job.time}};
  auto scenes = backend.prepare({&at, 1}, {});
  REQUIRE(scenes.has_value());
  shot.open = shot.still = scenes->front();
  auto film = backend.begin({&shot, 1});
  REQUIRE(film.has_value());
  while (!backend.probe(**film, {}, {}).value()) {
  }
  u32 left = 0;
  for (const WorkRange& range : ranges) {
    double share = 0;
    while (!backend.render(**film, range, {}, {}).value()) {
      REQUIRE((*film)->share_of_range() > share);
      share = (*film)->share_of_range();
      ++left;
    }
    REQUIRE((*film)->share_of_range() == 0);
  }
  CHECK(left > 0);
  auto planes = backend.resolve(**film);
  REQUIRE(planes.has_value());
  return *std::move(planes);
}

/// The tiles in groups of `tiles`, last first, each with its samples in groups of `samples`.
std::vector<WorkRange> split(u32 all_tiles, u32 tiles, u32 all_samples, u32 samples) {
  std::vector<WorkRange> ranges;
  for (u32 tile = (all_tiles - 1) / tiles * tiles + tiles; tile > 0;) {
    tile -= tiles;
    for (u32 sample = 0; sample < all_samples; sample += samples)
      ranges.push_back({tile, std::min(tiles, all_tiles - tile), sample,
                        std::min(samples, all_samples - sample)});
  }
  return ranges;
}

}  // namespace

TEST_CASE("embree: the same bits for any grouping of tiles and samples") {
  constexpr u32 kSamples = 21, kTiles = 3 * 3;  // 42 x 37 pixels: cut tiles at two edges
  auto job = job_of(still_life().apply(),
                    {Plane::BEAUTY, Plane::DEPTH, Plane::VARIANCE, Plane::INSTANCE}, kSamples);
  job.width = 42;
  job.height = 37;
  auto one = make_backend("embree", {.threads = 1}), two = make_backend("embree", {.threads = 2});
  REQUIRE((one.has_value() && two.has_value()));
  const auto whole = planes_by_ranges(**one, job, {{0, kTiles, 0, kSamples}});
  for (const u32 tiles : {1u, 2u, 4u, 9u})
    for (const u32 samples : {1u, 5u, 16u, 21u}) {
      INFO(tiles << " tiles, " << samples << " samples");
      const auto parts = planes_by_ranges(**two, job, split(kTiles, tiles, kSamples, samples));
      REQUIRE(parts.size() == whole.size());
      for (std::size_t i = 0; i < parts.size(); ++i) CHECK(parts[i].pixels == whole[i].pixels);
    }
}

TEST_CASE("embree: a frame after edits equals that of a fresh renderer") {
  auto engine = make_engine(2);
  const std::vector planes{Plane::BEAUTY, Plane::DEPTH, Plane::INSTANCE, Plane::OBJECT_COORDINATES};
  const auto base = still_life().apply();
  const auto first = render(*engine, job_of(base, planes, 4));

  const auto moved = Edits().pose("box", translation({-0.9f, 0.8f, 0.5f})).apply(*base);
  const auto painted = Edits().material("red", vec3(0.1f, 0.7f, 0.2f)).apply(*moved);
  PutEntity hide;
  hide.visible = false;
  const auto hidden = Edits().put("ball", hide).apply(*painted);
  const auto added = Edits().object("third", "cube", translation({0, -1, 2})).apply(*hidden);
  Transaction removal;
  removal.edits.push_back({Mode::kUpdate, std::string("box"), Remove{}});
  const auto removed = heliograph::apply(*added, removal, {});
  REQUIRE(removed.has_value());
  const auto relit = Edits().dome(vec3(2)).apply(*removed->snapshot);
  Light dim;
  dim.intensity = 1;
  const auto dimmed = Edits().light("lamp", dim).apply(*relit);

  for (const auto& scene :
       {moved, painted, hidden, added, removed->snapshot, relit, dimmed, moved, base}) {
    auto fresh = make_engine(2);
    CHECK(same_planes(*render(*engine, job_of(scene, planes, 4)),
                      *render(*fresh, job_of(scene, planes, 4))));
  }
  CHECK(same_planes(*first, *render(*engine, job_of(base, planes, 4))));
  CHECK(!same_planes(*first, *render(*engine, job_of(moved, planes, 4))));
}

TEST_CASE("embree: static entities show the same picture, whatever came before") {
  auto engine = make_engine(2);
  const std::vector planes{Plane::BEAUTY, Plane::INSTANCE, Plane::PRIMITIVE, Plane::DEPTH};
  PutEntity fixed, hidden_from_camera;
  fixed.is_static = true;
  hidden_from_camera.visibility = u8(kAllRays & ~kCameraRay);
  Edits world = still_life(), fix;
  fix.put("box", fixed).put("ball", fixed).put("floor", fixed);
  for (int i = 0; i < 36; ++i) {  // so many that they are traced as one mesh
    const std::string name = fmt::format("stone {}", i);
    const int row = i / 6;
    world.object(name, "cube",
                 scaled(vec3(0.1f), {0.3f * float(i - 6 * row) - 1, 0.3f * float(row) - 1, 0.05f}));
    fix.put(name, fixed);
  }
  const auto loose = world.apply();
  const auto all = fix.apply(*loose);
  const auto frame = render(*engine, job_of(loose, planes, 16));
  const auto grouped = render(*engine, job_of(all, planes, 16));
  CHECK(grouped->planes[1].pixels == frame->planes[1].pixels);
  CHECK(grouped->planes[2].pixels == frame->planes[2].pixels);
  const auto depths = pixels<float>(*frame, 3), grouped_depths = pixels<float>(*grouped, 3);
  for (std::size_t i = 0; i < depths.size(); ++i)
    CHECK(grouped_depths[i] == Approx(depths[i]).epsilon(1e-5));
  const auto light = pixels<float>(*frame), grouped_light = pixels<float>(*grouped);
  const auto sum = [](std::span<const float> v) {
    return std::accumulate(v.begin(), v.end(), 0.0);
  };
  CHECK(sum(grouped_light) == Approx(sum(light)).epsilon(1e-3));

  PutEntity loosened;
  loosened.is_static = false;
  const auto moved = Edits().pose("box", translation({-0.9f, 0.8f, 0.5f})).apply(*all);
  const auto unseen = Edits().put("ball", hidden_from_camera).apply(*moved);
  const auto freed = Edits().put("box", loosened).apply(*unseen);
  for (const auto& scene : {moved, unseen, freed, all}) {
    auto fresh = make_engine(2);
    CHECK(same_planes(*render(*engine, job_of(scene, planes, 4)),
                      *render(*fresh, job_of(scene, planes, 4))));
  }
  CHECK(!same_planes(*render(*engine, job_of(unseen, planes, 4)),
                     *render(*engine, job_of(moved, planes, 4))));
}

TEST_CASE("embree: branches do not see each other's edits") {
  auto engine = make_engine(2);
  const std::vector planes{Plane::BEAUTY};
  const auto base = still_life().apply();
  const auto left = Edits().pose("ball", scaled(vec3(0.5f), {-2, 0, 0.5f})).apply(*base);
  const auto right = Edits().pose("ball", scaled(vec3(0.5f), {2, 0, 0.5f})).apply(*base);
  const auto a = render(*engine, job_of(left, planes, 4));
  const auto b = render(*engine, job_of(right, planes, 4));
  CHECK(!same_planes(*a, *b));
  CHECK(same_planes(*a, *render(*engine, job_of(left, planes, 4))));
  CHECK(same_planes(*b, *render(*engine, job_of(right, planes, 4))));
}

TEST_CASE("embree: units of light give the irradiance they promise") {
  auto engine = make_engine();
  // A small lamp at height 1 over the point looked at; irradiance there is I / h^2 with I = L A.
  const float side = 0.1f, area = side * side;
  const auto lit_by = [&](Light light, bool scale_y = false) {
    const float y = scale_y ? 2 * side : side;
    return Edits()
        .mesh("quad", quad())
        .material("matte", vec3(0.5f))
        .put("matte",
             [] {
               PutMaterial m;
               m.parameters[std::size_t(MaterialParameter::specular)].value = vec3(0);
               return m;
             }())
        .object("floor", "quad", scaled(vec3(4), vec3(0)), "matte")
        .object("lamp", "quad", mat4x3(side, 0, 0, 0, -y, 0, 0, 0, -1, 0, 0, 1), "matte")
        .light("lamp", light)
        .camera("camera", look_at({0, -1, 1}, vec3(0)), 1, 1, 400)
        .apply();
  };
  const auto radiance = [&](const std::shared_ptr<const Snapshot>& scene) {
    auto job = job_of(scene, {Plane::BEAUTY}, 512);
    job.settings.max_depth = 2;
    return double(pixels<float>(*render(*engine, job))[1]);
  };
  const double reflected = 0.5 / M_PI;  // of irradiance, by the floor
  Light light;
  light.intensity = 100;
  CHECK(radiance(lit_by(light)) == Approx(reflected * 100 * area).epsilon(0.01));
  light.unit = LightUnit::kPower;
  light.intensity = float(M_PI);  // L = 1 / A whatever the lamp's size
  CHECK(radiance(lit_by(light)) == Approx(reflected).epsilon(0.01));
  CHECK(radiance(lit_by(light, true)) == Approx(reflected).epsilon(0.01));
  light.two_sided = true;
  CHECK(radiance(lit_by(light)) == Approx(reflected / 2).epsilon(0.01));
  light.two_sided = false;
  light.unit = LightUnit::kLumen;
  light.intensity = float(683 * M_PI);
  light.exposure = 1;
  CHECK(radiance(lit_by(light)) == Approx(2 * reflected).epsilon(0.01));
}

TEST_CASE("embree: cut-outs are holes to camera, shadow and centre rays") {
  auto engine = make_engine();
  PutMaterial paper;
  paper.parameters[std::size_t(MaterialParameter::alpha)].value = vec3(0.25f);
  SECTION("blend: a share of the rays meets the surface") {
    paper.alpha_mode = AlphaMode::kBlend;
    const auto scene = Edits()
                           .mesh("quad", quad())
                           .material("paper", vec3(0))
                           .put("paper", paper)
                           .object("sheet", "quad", scaled(vec3(9), vec3(0)), "paper")
                           .camera("camera", look_at({0, 0, 3}, vec3(0)), 16, 16, 16)
                           .apply();
    const auto frame = render(*engine, job_of(scene, {Plane::COVERAGE, Plane::INSTANCE}, 256));
    double mean = 0;
    for (const float c : pixels<float>(*frame)) mean += double(c) / 256;
    CHECK(mean == Approx(0.25).margin(4 * std::sqrt(0.25 * 0.75 / 65536)));  // 4 sigma
    for (const u32 label : pixels<u32>(*frame, 1)) CHECK(label == 0);
  }
  SECTION("mask: below the cutoff nothing is there") {
    paper.alpha_mode = AlphaMode::kMask;
    const auto with = [&](float cutoff) {
      paper.alpha_cutoff = cutoff;
      const auto scene = Edits()
                             .mesh("quad", quad())
                             .material("paper", vec3(0.5f))
                             .put("paper", paper)
                             .object("sheet", "quad", scaled(vec3(9), vec3(0, 0, 1)), "paper")
                             .object("floor", "quad", scaled(vec3(4), vec3(0)))
                             .camera("camera", look_at({0, 0, 3}, vec3(0)), 8, 8, 8)
                             .apply();
      return render(*engine, job_of(scene, {Plane::DEPTH}));
    };
    const auto hole = with(0.5f), sheet = with(0.125f);
    for (const float z : pixels<float>(*hole)) CHECK(z == Approx(3));
    for (const float z : pixels<float>(*sheet)) CHECK(z == Approx(2));
  }
}
