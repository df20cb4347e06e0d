// How long the slices of a job are, on a device whose tiles do not take the same time.
#include "renderer/schedule/runner.h"

#include <thread>

#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

using Seconds = std::chrono::duration<double>;

constexpr Seconds kSlice{4e-3};
constexpr Seconds kCheap{3e-5};  // of one sample of a tile
constexpr double kDear = 8;      // times that, in the middle of the image

Error not_there() {
  return {.code = Code::kUnimplemented, .message = "it only takes time", .where = ""};
}

class SlowFilm final : public Film {
 public:
  [[nodiscard]] u32 tiles() const override { return 16 * 16; }
  [[nodiscard]] u32 tiles_across() const override { return 16; }
  [[nodiscard]] u32 samples(u32) const override { return 0; }
  [[nodiscard]] u64 rays() const override { return 0; }
  [[nodiscard]] Noise noise() const override { return {}; }
  [[nodiscard]] Expected<FilmPart> take(const TileRun&) override {
    return std::unexpected(not_there());
  }
  [[nodiscard]] Status put(const FilmPart&) override { return std::unexpected(not_there()); }

  u32 next = 0;  // tile of the range that was left
};

class EmptyScene final : public DeviceScene {
 public:
  [[nodiscard]] SceneSummary summary() const override { return {}; }
};

/// Sleeps for as long as an uneven image takes, a tile at a time.
class SlowBackend final : public Backend {
 public:
  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] DeviceUse use() const override { return {}; }
  void run(const std::function<void()>& f) override { f(); }
  [[nodiscard]] Preparation preparation(const SceneAt&) const override { return {}; }
  [[nodiscard]] Expected<DeviceScenes> prepare(std::span<const SceneAt> scenes,
                                               const Interrupt&) override {
    return DeviceScenes(scenes.size(), std::make_shared<const EmptyScene>());
  }
  [[nodiscard]] Expected<std::unique_ptr<Film>> begin(std::span<const Shot>) override {
    return std::make_unique<SlowFilm>();
  }
  [[nodiscard]] Expected<bool> render(Film& film, const WorkRange& range, const Slice& slice,
                                      const Interrupt&) override {
    u32& next = static_cast<SlowFilm&>(film).next;
    while (next < range.tile_count) {
      const u32 tile = range.first_tile + next++;
      const u32 x = tile % film.tiles_across(), y = tile / film.tiles_across();
      const bool is_dear = x >= 4 && x < 12 && y >= 4 && y < 12;
      const Seconds time = (is_dear ? kDear : 1) * range.sample_count * kCheap;
      std::this_thread::sleep_for(time);
      taken += time;
      if (next < range.tile_count && slice.is_over()) return false;
    }
    next = 0;
    return true;
  }
  [[nodiscard]] Expected<bool> probe(Film&, const Slice&, const Interrupt&) override {
    return true;
  }
  [[nodiscard]] Expected<std::vector<std::vector<Column>>> labels(Film&,
                                                                  const Interrupt&) override {
    return std::unexpected(not_there());
  }
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve(Film&) override {
    return std::unexpected(not_there());
  }
  [[nodiscard]] Expected<QueryResult> query(const QueryJob&, const Interrupt&) override {
    return std::unexpected(not_there());
  }

  Seconds taken{0};  // as it should, whatever else the machine does

 private:
  const DeviceInfo info_{.name = "slow", .cpu_features = ""};
};

class Told final : public JobSink {
 public:
  void progress(const Progress&) override { ++times; }
  void frame(std::shared_ptr<const Frame>) override {}
  void done(Status, const Spent&) override {}

  u32 times = 0;
};

}  // namespace

TEST_CASE("runner: who comes while a job runs waits for less than a slice, cheap tiles or dear") {
  SlowBackend backend;
  Denoiser denoiser("off", 1);
  Collect sink;
  const Interrupt interrupt;
  const auto scene = Edits().camera("camera", mat4x3(1), 256, 256, 200).apply();
  Runner runner(std::make_shared<const RenderJob>(job_of(scene, {Plane::BEAUTY}, 64)),
                {backend, denoiser, &sink, interrupt, kSlice});
  double squares = 0;
  for (bool is_done = false; !is_done;) {
    const Seconds before = backend.taken;
    is_done = runner.step();
    squares += std::pow((backend.taken - before).count(), 2);
  }
  CHECK(runner.samples() == 64 * 256 * 256);
  // Who comes at any time comes in a slice of length s with a probability that grows with s, and
  // waits for half of it.
  const double wait = squares / 2 / backend.taken.count();
  CHECK(wait <= kSlice.count());
}

TEST_CASE("runner: a slice ends where somebody waits, and later where nobody does") {
  const auto now = std::chrono::steady_clock::now();
  const TimePoint past = now - std::chrono::hours(1), future = now + std::chrono::hours(1);
  WaitingJobs waiting;
  CHECK_FALSE(Slice{past, past, future, &waiting}.is_over());
  CHECK(Slice{past, past, past, &waiting}.is_over());
  waiting.all = 1;
  CHECK(Slice{past, past, future, &waiting}.is_over());
  CHECK_FALSE(Slice{past, future, future, &waiting}.is_over());
  waiting.fresh = 1;
  CHECK(Slice{past, future, future, &waiting}.is_over());
  CHECK_FALSE(Slice{future, future, future, &waiting}.is_over());
  CHECK(Slice{future, past, future}.is_over());
}

TEST_CASE("runner: jobs that take turns tell their progress no more often than one alone") {
  SlowBackend backend;
  Denoiser denoiser("off", 1);
  Told sink;
  const Interrupt interrupt;
  const auto scene = Edits().camera("camera", mat4x3(1), 256, 256, 200).apply();
  Runner runner(std::make_shared<const RenderJob>(job_of(scene, {Plane::BEAUTY}, 16)),
                {backend, denoiser, &sink, interrupt, kSlice});
  Seconds used{0};
  for (bool is_done = false; !is_done;) {
    const auto start = std::chrono::steady_clock::now();
    is_done = runner.step();
    used += std::chrono::steady_clock::now() - start;
    std::this_thread::sleep_for(2 * kSlice);  // others have the device
  }
  CHECK(sink.times > 0);
  CHECK(sink.times <= used.count() / 0.1);
}
