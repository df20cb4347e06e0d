// Worlds: what differs between copies of a scene, and their pictures packed into one frame.
#include "renderer/frame/worlds.h"

#include "renderer/scene/worlds.h"
#include "renderer/schedule/runner.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

constexpr u32 kWorlds = 5;
const std::vector<Plane> kPlanes{Plane::DEPTH, Plane::BEAUTY, Plane::BEAUTY_GROUP,
                                 Plane::BEAUTY_GROUP, Plane::INSTANCE};

Edits recolor(u32 world) { return Edits().material("red", vec3(0.1f * float(world))); }

/// The box and the ball move with the world; worlds from 3 on have a colour of their own.
Worlds moving(const Snapshot& scene) {
  Worlds worlds{.count = kWorlds, .entities = {entity(scene, "box"), entity(scene, "ball")}};
  for (u32 i = 0; i < kWorlds; ++i) {
    worlds.poses.push_back(translation({0.6f, 0.3f, 0.5f + 0.1f * float(i)}));
    worlds.poses.push_back(scaled(vec3(0.5f), {-0.6f + 0.1f * float(i), -0.2f, 0.5f}));
    worlds.overlays.push_back(i < 3 ? Transaction{} : recolor(i).transaction());
    worlds.rendered.push_back(i);
  }
  return worlds;
}

/// The same edits as an overlay of its own.
std::shared_ptr<const Snapshot> alone(const Snapshot& scene, const Worlds& worlds, u32 i) {
  auto made =
      Edits().pose("box", worlds.poses[2 * i]).pose("ball", worlds.poses[2 * i + 1]).apply(scene);
  return i < 3 ? made : recolor(i).apply(*made);
}

RenderJob packed_job(const std::shared_ptr<const Snapshot>& scene, Worlds worlds) {
  RenderJob job = job_of(scene, kPlanes, 2);
  job.groups = {"", "lamps"};
  job.labels.boxes = true;
  job.worlds = std::make_shared<const Worlds>(std::move(worlds));
  return job;
}

/// Pictures of Embree's, side by side.
class ManyFilms final : public Film {
 public:
  [[nodiscard]] u32 tiles() const override { return u32(films.size()) * films[0]->tiles(); }
  [[nodiscard]] u32 tiles_across() const override { return films[0]->tiles_across(); }
  [[nodiscard]] u32 samples(u32 tile) const override {
    return films[tile / films[0]->tiles()]->samples(tile % films[0]->tiles());
  }
  [[nodiscard]] u64 rays() const override {
    u64 sum = 0;
    for (const auto& film : films) sum += film->rays();
    return sum;
  }
  [[nodiscard]] Noise noise() const override { return {}; }
  [[nodiscard]] Expected<FilmPart> take(const TileRun&) override {
    return fail(Code::kUnimplemented, "", "worlds are not spread over devices");
  }
  [[nodiscard]] Status put(const FilmPart&) override {
    return fail(Code::kUnimplemented, "", "worlds are not spread over devices");
  }
  std::vector<std::unique_ptr<Film>> films;
  std::shared_ptr<const RenderJob> job;
};

/// Renders as Embree does, several pictures in a film.
class ManyPictures final : public Backend {
 public:
  explicit ManyPictures(u32 at_once)
      : inner_(make_backend("embree", {.threads = 2}).value()),
        info_{.name = inner_->info().name,
              .cpu_features = inner_->info().cpu_features,
              .film_pixels = ~u64(0),
              .film_pictures = at_once} {}
  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] DeviceUse use() const override { return inner_->use(); }
  void run(const std::function<void()>& f) override { inner_->run(f); }
  /// The test has no workers who would run errands.
  [[nodiscard]] Preparation preparation(const SceneAt&) const override { return {}; }
  [[nodiscard]] Expected<DeviceScenes> prepare(std::span<const SceneAt> scenes,
                                               const Interrupt& interrupt) override {
    return inner_->prepare(scenes, interrupt);
  }
  [[nodiscard]] Expected<std::unique_ptr<Film>> begin(std::span<const Shot> shots) override {
    auto made = std::make_unique<ManyFilms>();
    made->job = shots.front().job;
    for (Shot shot : shots) {
      auto job = std::make_shared<RenderJob>(*shot.job);
      job->memory = nullptr;
      shot.job = job;
      made->films.push_back(inner_->begin({&shot, 1}).value());
    }
    ++films;
    return made;
  }
  [[nodiscard]] Expected<bool> render(Film& film, const WorkRange& range, const Slice& slice,
                                      const Interrupt& interrupt) override {
    for_each_part(film, range.first_tile, range.tile_count, [&](Film& own, u32 first, u32 count) {
      WorkRange part = range;
      part.first_tile = first;
      part.tile_count = count;
      while (!inner_->render(own, part, slice, interrupt).value()) {
      }
    });
    return true;
  }
  [[nodiscard]] Expected<bool> probe(Film& film, const Slice& slice,
                                     const Interrupt& interrupt) override {
    for (const auto& own : static_cast<ManyFilms&>(film).films)
      while (!inner_->probe(*own, slice, interrupt).value()) {
      }
    return true;
  }
  [[nodiscard]] Expected<std::vector<std::vector<Column>>> labels(
      Film& film, const Interrupt& interrupt) override {
    std::vector<std::vector<Column>> all;
    for (const auto& own : static_cast<ManyFilms&>(film).films)
      all.push_back(inner_->labels(*own, interrupt).value().front());
    return all;
  }
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve(Film& film) override {
    auto& own = static_cast<ManyFilms&>(film);
    std::vector<PlaneData> all;
    for (u32 i = 0; i < own.films.size(); ++i) {
      const auto planes = inner_->resolve(*own.films[i]).value();
      for (std::size_t p = 0; p < planes.size(); ++p) {
        const Pixels& from = planes[p].pixels;
        if (i == 0) {
          const u64 bytes = from.size() * own.films.size();
          all.push_back({planes[p].plane, Pixels(planes[p].plane, bytes, own.job->memory)});
        }
        std::ranges::copy_n(from.data(), i64(from.size()), all[p].pixels.data() + i * from.size());
      }
    }
    return all;
  }
  [[nodiscard]] Expected<QueryResult> query(const QueryJob& job,
                                            const Interrupt& interrupt) override {
    return inner_->query(job, interrupt);
  }

  u32 films = 0;  // begun

 private:
  template <class F>
  void for_each_part(Film& film, u32 first, u32 count, const F& f) {
    auto& own = static_cast<ManyFilms&>(film);
    const u32 each = own.films[0]->tiles();
    for (u32 tile = first; tile < first + count;) {
      const u32 taken = std::min(each - tile % each, first + count - tile);
      f(*own.films[tile / each], tile % each, taken);
      tile += taken;
    }
  }

  const std::unique_ptr<Backend> inner_;
  const DeviceInfo info_;
};

Edits stage() {
  PutEntity grouped;
  grouped.light_group = "lamps";
  return still_life()
      .put("lamp", grouped)
      .camera("side", look_at({4, 4, 3}, {0, 0, 0}), 64, 48, 60);
}

Error refusal(const RenderJob& job) {
  const Status status = check_job(job, {});
  REQUIRE(!status.has_value());
  return status.error();
}

}  // namespace

TEST_CASE("worlds: a world without anything of its own is the scene") {
  const auto scene = stage().apply();
  CHECK(world_of(scene, {.count = 3}, 2).value() == scene);
}

TEST_CASE("worlds: errors name the world, and what all have in common stays") {
  const auto scene = stage().apply();
  Worlds worlds{.count = 2};
  const auto refused = [&](const Edits& edits) {
    worlds.overlays = {{}, edits.transaction()};
    CHECK(world_of(scene, worlds, 0).has_value());
    const auto made = world_of(scene, worlds, 1);
    REQUIRE(!made.has_value());
    return made.error();
  };
  CHECK(refused(Edits().object("x", "nothing", mat4x3(1))).where ==
        "overlays[1].edits[0].entity.mesh");
  CHECK(refused(Edits().put(PutSettings{.time = 3})).where == "overlays[1]");
  CHECK(refused(Edits().put(PutSettings{.categories = {"bolt"}})).message.find("'bolt'") !=
        std::string::npos);
  worlds = {.count = 1, .entities = {EntityId::make(77, 5)}, .poses = {mat4x3(1)}};
  CHECK(world_of(scene, worlds, 0).error().where == "poses");
}

TEST_CASE("worlds: every picture has the bytes of a job of its own, in its place") {
  const auto scene = stage().apply();
  const Worlds worlds = moving(*scene);
  const auto engine = make_engine(2);
  RenderJob job = packed_job(scene, worlds);
  job.cameras.push_back(entity(*scene, "side"));
  const u32 cameras = 2;
  std::vector<std::pair<Plane, u64>> asked;
  job.memory = [&](Plane plane, u64 bytes) -> std::shared_ptr<PixelMemory> {
    asked.emplace_back(plane, bytes);
    return nullptr;
  };
  const auto packed = render(*engine, job);
  REQUIRE(packed->worlds);
  CHECK(packed->worlds->cameras == std::vector<std::string>{"camera", "side"});
  REQUIRE(asked.size() == kPlanes.size());
  for (std::size_t i = 0; i < kPlanes.size(); ++i) CHECK(asked[i].first == kPlanes[i]);
  for (u32 i = 0; i < kWorlds; ++i)
    for (u32 camera = 0; camera < cameras; ++camera) {
      RenderJob own = packed_job(alone(*scene, worlds, i), worlds);
      own.worlds = nullptr;
      own.cameras = {job.cameras[camera]};
      own.settings.seed = world_seed(job.settings.seed, i);
      const auto single = render(*engine, own);
      const u32 picture = i * cameras + camera;
      CHECK(packed->worlds->camera_from_world_cv[picture] == single->camera_from_world_cv);
      CHECK(packed->worlds->k[picture] == single->k);
      for (std::size_t plane = 0; plane < kPlanes.size(); ++plane) {
        const Pixels& all = packed->planes[plane].pixels;
        const Pixels& one = single->planes[plane].pixels;
        REQUIRE(all.size() == one.size() * kWorlds * cameras);
        CHECK(std::memcmp(all.data() + picture * one.size(), one.data(), one.size()) == 0);
      }
    }
}

TEST_CASE("worlds: a backend may have several pictures in one film") {
  const auto scene = stage().apply();
  RenderJob job = packed_job(scene, moving(*scene));
  job.cameras.push_back(entity(*scene, "side"));
  job.labels.boxes = true;
  const auto one_by_one = render(*make_engine(2), job);
  for (const u32 at_once : {1u, 3u, 4u, 100u}) {
    INFO(at_once);
    ManyPictures backend(at_once);
    Denoiser denoiser("off", 1);
    Collect sink;
    const Interrupt never{};
    Runner runner(std::make_shared<const RenderJob>(job),
                  {backend, denoiser, &sink, never, std::chrono::milliseconds(5)});
    while (!runner.step()) continue;
    REQUIRE(runner.result().has_value());
    REQUIRE(sink.frames.size() == 1);
    CHECK(backend.films == (2 * kWorlds + at_once - 1) / at_once);
    const Frame& frame = *sink.frames[0];
    for (std::size_t plane = 0; plane < kPlanes.size(); ++plane)
      CHECK(frame.planes[plane].pixels == one_by_one->planes[plane].pixels);
    CHECK(frame.worlds->camera_from_world_cv == one_by_one->worlds->camera_from_world_cv);
    CHECK(frame.worlds->seeds == one_by_one->worlds->seeds);
    CHECK(frame.rays == one_by_one->rays);
    REQUIRE(frame.labels.size() == one_by_one->labels.size());
    for (std::size_t i = 0; i < frame.labels.size(); ++i)
      CHECK(frame.labels[i].data == one_by_one->labels[i].data);
  }
}

TEST_CASE("worlds: those that a mask leaves out are neither rendered nor made") {
  const auto scene = stage().apply();
  Worlds worlds = moving(*scene);
  const auto engine = make_engine(2);
  const auto full = render(*engine, packed_job(scene, worlds));
  worlds.rendered = {1, 3};
  worlds.overlays[4] = Edits().object("x", "nothing", mat4x3(1)).transaction();
  const auto some = render(*engine, packed_job(scene, worlds));
  CHECK(some->worlds->worlds == worlds.rendered);
  for (std::size_t plane = 0; plane < kPlanes.size(); ++plane) {
    const u64 bytes = full->planes[plane].pixels.size() / kWorlds;
    REQUIRE(some->planes[plane].pixels.size() == 2 * bytes);
    for (u32 i = 0; i < 2; ++i)
      CHECK(std::memcmp(some->planes[plane].pixels.data() + i * bytes,
                        full->planes[plane].pixels.data() + worlds.rendered[i] * bytes,
                        bytes) == 0);
  }
  worlds.rendered = {4};
  CHECK(refusal(packed_job(scene, worlds)).where == "worlds.overlays[4].edits[0].entity.mesh");
}

TEST_CASE("worlds: stop rules, sizes and rows that do not fit are refused") {
  const auto scene = stage().apply();
  const RenderJob good = packed_job(scene, moving(*scene));
  REQUIRE(check_job(good, {}).has_value());
  auto job = good;
  job.stop.noise = 0.1;
  CHECK(refusal(job).where == "noise");
  job = good;
  job.progressive = true;
  CHECK(refusal(job).where == "progressive");
  job = good;
  job.labels.max_rows = 4 * kWorlds - 1;
  CHECK(refusal(job).needed == 4 * kWorlds);
  job.labels.max_rows = 4 * kWorlds;
  CHECK(check_job(job, {}).has_value());

  Worlds worlds = moving(*scene);
  worlds.overlays[3] = Edits().camera("camera", mat4x3(1), 32, 48, 60).transaction();
  CHECK(refusal(packed_job(scene, worlds)).message.starts_with("in world 3: is 32 x 48"));
  worlds.overlays[3] = Edits().put("camera", Remove{}).transaction();
  CHECK(refusal(packed_job(scene, worlds)).code == Code::kNotFound);
}

TEST_CASE("worlds: a world's own meshes are derived before the device has the job") {
  const auto scene = stage().apply();
  Worlds worlds = moving(*scene);
  worlds.overlays[4] =
      Edits().mesh("own", sphere(8)).object("x", "own", translation({0, 0, 1})).transaction();
  const RenderJob job = packed_job(scene, worlds);
  const auto needed = needed_snapshots(job);
  REQUIRE(needed.size() == 2);
  CHECK(needed[0] == scene);
  CHECK(needed[1]->find("own").has_value());
  const auto engine = make_engine(2);
  CHECK(render(*engine, job)->worlds->worlds.size() == kWorlds);
}
