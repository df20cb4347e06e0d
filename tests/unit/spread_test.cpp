// One picture by several devices: who renders what, and that the bytes do not tell.
#include "renderer/schedule/spread.h"

#include <cstdlib>

#include "renderer/schedule/runner.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;
using namespace std::chrono_literals;

namespace {

constexpr u32 kAcross = 30, kRows = 70;

std::shared_ptr<Spread> new_spread() {
  return std::make_shared<Spread>(std::make_shared<const RenderJob>(), 0, kAcross * kRows, kAcross);
}

/// Counts claims of tiles.
struct Claimed {
  std::vector<u32> times = std::vector<u32>(kAcross * kRows);

  void add(const TileRun& run) {
    CHECK(run.first % kAcross == 0);
    CHECK(run.count % kAcross == 0);
    for (u32 i = 0; i < run.count; ++i) ++times[run.first + i];
  }
  [[nodiscard]] bool is_each_once() const {
    return std::ranges::all_of(times, [](u32 n) { return n == 1; });
  }
};

/// `width` x 395 pixels: the last tiles of rows and columns are cut.
RenderJob large_job(const std::shared_ptr<const Snapshot>& scene, u32 width, u32 spp) {
  RenderJob job =
      job_of(scene, {Plane::BEAUTY, Plane::DEPTH, Plane::VARIANCE, Plane::COVERAGE}, spp);
  job.width = width;
  job.height = 395;
  job.settings.max_depth = 2;
  return job;
}

/// "embree", or what a script that has a GPU asks for.
std::string backend_name() {
  const char* name = std::getenv("HELIOGRAPH_TEST_BACKEND");
  return name ? name : "embree";
}

/// Runner::step(), and at once what is to be done before the next one.
bool step(Runner& runner) {
  const bool is_done = runner.step();
  for (const Errand& errand : runner.take_errands()) errand.run({});
  return is_done;
}

/// A job by two devices in turns, in one thread: when the job's own asks, the helper takes a step.
/// It is given up after `lives` of them.
class Pair final : public Others {
 public:
  Pair(const RenderJob& job, u32 lives) : lives_(lives) {
    Runner owner(std::make_shared<const RenderJob>(job),
                 {*first_, denoiser_, &sink, interrupt_, 2ms, nullptr, this, 0});
    for (bool is_done = false; !is_done;) {
      is_done = step(owner);
      help();
    }
    helper_.reset();
    REQUIRE(owner.result());
    CHECK(owner.samples() >= helped);
  }
  void invite(const std::shared_ptr<Spread>& spread) override {
    if (!spread_) spread_ = spread;
    help();
  }

  Collect sink;
  u64 helped = 0;  // samples that the helper took

 private:
  void help() {
    if (!spread_ || lives_ == 0) return;
    if (!helper_)
      helper_.emplace(spread_, RunnerContext{*second_, denoiser_, nullptr, interrupt_, 2ms});
    const bool has_ended = step(*helper_);
    helped = helper_->samples();
    if (!has_ended && --lives_ > 0) return;
    lives_ = 0;
    helper_.reset();
  }

  const std::unique_ptr<Backend> first_ = *make_backend(backend_name(), {.threads = 1});
  const std::unique_ptr<Backend> second_ = *make_backend(backend_name(), {.threads = 1});
  const Interrupt interrupt_;
  Denoiser denoiser_{"off", 1};
  std::shared_ptr<Spread> spread_;
  std::optional<Runner> helper_;
  u32 lives_;
};

}  // namespace

TEST_CASE("spread: every tile is claimed once, in whole rows, in runs that get shorter") {
  const auto spread = new_spread();
  REQUIRE(spread->join(1));
  CHECK(!spread->join(1));
  Claimed claimed;
  u32 longest = ~0u, runs = 0;
  while (auto claim = Spread::claim(spread)) {
    claimed.add(claim->tiles());
    CHECK(claim->tiles().count <= longest);
    longest = claim->tiles().count;
    ++runs;
    CHECK(!spread->is_complete());
    if (runs % 2 == 0)
      claim->deliver({.tiles = claim->tiles()});
    else
      claim->done();
  }
  CHECK(runs > 3);
  CHECK(claimed.is_each_once());
  CHECK(spread->is_complete());
  CHECK(spread->collect().size() == runs / 2);
  CHECK(spread->collect().empty());
}

TEST_CASE("spread: what is given up is claimed again") {
  const auto spread = new_spread();
  Claimed claimed;
  u32 runs = 0;
  while (auto claim = Spread::claim(spread)) {
    if (runs++ % 3 == 0) continue;
    claimed.add(claim->tiles());
    claim->done();
  }
  CHECK(claimed.is_each_once());
  CHECK(spread->is_complete());
}

TEST_CASE("spread: a picture by two devices has the bytes of one, also when the helper is lost") {
  const auto scene = still_life().apply();
  const auto engine = *Engine::create({.backend = backend_name(), .devices = 1});
  for (const auto& [width, spp, lives] :
       {std::tuple{400u, 3u, ~0u}, {400u, 3u, 4u}, {210u, 20u, ~0u}}) {
    const RenderJob job = large_job(scene, width, spp);
    const auto alone = render(*engine, job);
    const Pair pair(job, lives);
    REQUIRE(pair.sink.frames.size() == 1);
    CHECK(same_planes(*pair.sink.frames[0], *alone));
    CHECK(pair.sink.frames[0]->rays == alone->rays);
    CHECK(pair.helped > 0);
  }
}

TEST_CASE("spread: what stops by its noise is rendered by one device") {
  RenderJob job = large_job(still_life().apply(), 210, 20);
  job.stop.noise = 0.5;
  const Pair pair(job, ~0u);
  CHECK(pair.helped == 0);
  CHECK(pair.sink.frames.size() == 1);
}

TEST_CASE("spread: an engine's idle devices help, and the bytes are the same") {
  const auto scene = still_life().apply();
  const auto one = make_engine(1);
  const auto three = *Engine::create({.devices = 3, .device = {.threads = 1}, .spread_samples = 1});
  double helper_seconds = 0;
  for (u64 seed = 0; seed < 3; ++seed) {
    RenderJob job = large_job(scene, 400, 4);
    job.settings.seed = seed;
    const auto sink = std::make_shared<Collect>();
    REQUIRE(three->submit(std::make_shared<const RenderJob>(job), sink, {}));
    REQUIRE(sink->wait());
    const auto alone = render(*one, job);
    CHECK(same_planes(*sink->frames.back(), *alone));
    CHECK(sink->frames.back()->rays == alone->rays);
    CHECK(sink->spent.helper_seconds < sink->spent.seconds);
    helper_seconds += sink->spent.helper_seconds;
  }
  CHECK(helper_seconds > 0);
}
