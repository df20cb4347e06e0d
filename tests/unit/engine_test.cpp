// The engine: what it refuses, how jobs stop, and the order of what it sends.
#include "renderer/schedule/engine.h"

#include <set>
#include <thread>

#include "renderer/frame/check.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;
using namespace std::chrono_literals;

namespace {

Error refusal(const RenderJob& job) {
  const Status status = check_job(job, {});
  REQUIRE(!status.has_value());
  return status.error();
}

}  // namespace

TEST_CASE("engine: names the field of what it refuses") {
  const auto scene = still_life().apply();
  const RenderJob good = job_of(scene, {Plane::BEAUTY}, 1);
  REQUIRE(check_job(good, {}).has_value());

  auto job = good;
  job.cameras.clear();
  CHECK(refusal(job).where == "cameras");
  job.cameras = {good.cameras[0], entity(*scene, "box")};
  CHECK(refusal(job).where == "cameras[1]");
  CHECK(refusal(job).code == Code::kFailedPrecondition);
  job.cameras = {EntityId::make(77, 5)};
  CHECK(refusal(job).code == Code::kNotFound);

  job = good;
  job.planes.clear();
  CHECK(refusal(job).where == "planes");
  job = good;
  job.stop.spp = 0;
  CHECK(refusal(job).where == "spp");
  job.stop.spp = (1u << 20) + 1;
  CHECK(refusal(job).code == Code::kInvalidArgument);
  job = good;
  job.height = 100000;
  CHECK(refusal(job).where == "height");
  job = good;
  job.width = job.height = 16384;
  job.planes = {Plane::BEAUTY, Plane::ALBEDO_MEAN, Plane::NORMAL_MEAN};
  CHECK(refusal(job).code == Code::kResourceExhausted);
  CHECK(refusal(job).needed > refusal(job).available);

  job = good;
  job.planes = {Plane::FLOW_FORWARD};
  CHECK(refusal(job).where == "frame_interval");
  CHECK(refusal(job).code == Code::kFailedPrecondition);
  job.frame_interval = 0.1;
  CHECK(refusal(job).code == Code::kFailedPrecondition);
  job.hold = true;
  CHECK(check_job(job, {}).has_value());
  job = good;
  job.planes = {Plane::DISPARITY};
  CHECK(refusal(job).where == "planes.camera");

  job = good;
  job.labels.boxes = true;
  job.labels.max_rows = 1;
  CHECK(refusal(job).code == Code::kResourceExhausted);
  CHECK(refusal(job).needed == 4);
}

TEST_CASE("engine: every plane has a name, a size and a fold") {
  CHECK(std::string(plane_info(Plane::BEAUTY).name) == "beauty");
  CHECK(plane_info(Plane::BEAUTY).channels == 4);
  CHECK(plane_info(Plane::INSTANCE).dtype == DType::kU32);
  CHECK(plane_info(Plane::FLOW_FORWARD_VALID).dtype == DType::kU8);
  CHECK(plane_info(Plane::VARIANCE).fold == kernels::Fold::kFilm);
}

TEST_CASE("engine: progressive frames double their samples") {
  auto engine = make_engine();
  auto job = job_of(still_life().apply(), {Plane::BEAUTY, Plane::SAMPLES}, 11);
  job.progressive = true;
  auto sink = std::make_shared<Collect>();
  REQUIRE(engine->submit(std::make_shared<const RenderJob>(job), sink, {}).has_value());
  REQUIRE(sink->wait().has_value());
  std::vector<u32> samples;
  for (const auto& frame : sink->frames) {
    samples.push_back(frame->samples);
    CHECK(pixels<u32>(*frame, 1)[0] == frame->samples);
    CHECK(frame->final == (frame == sink->frames.back()));
  }
  CHECK(samples == std::vector<u32>{1, 2, 4, 8, 11});
  CHECK(sink->last_progress.done == 1);
}

TEST_CASE("engine: stop rules") {
  auto engine = make_engine();
  const auto scene = still_life().apply();
  SECTION("seconds") {
    auto job = job_of(scene, {Plane::BEAUTY});
    job.stop.seconds = 0.3;
    const auto start = std::chrono::steady_clock::now();
    const auto frame = render(*engine, job);
    CHECK(frame->samples > 0);
    CHECK(std::chrono::steady_clock::now() - start < 2s);
  }
  SECTION("noise") {
    auto job = job_of(scene, {Plane::DEPTH});
    job.stop.noise = 0.2;
    const auto coarse = render(*engine, job);
    job.stop.noise = 0.05;
    const auto fine = render(*engine, job);
    CHECK(coarse->samples < fine->samples);
    CHECK(fine->samples < 100000);
  }
}

TEST_CASE("engine: a frame for each camera, in order") {
  auto engine = make_engine();
  const auto scene =
      Edits().camera("top", look_at({0, 0, 9}, vec3(0)), 20, 10, 20).apply(*still_life().apply());
  auto job = job_of(scene, {Plane::DEPTH});
  job.cameras.push_back(entity(*scene, "top"));
  auto sink = std::make_shared<Collect>();
  REQUIRE(engine->submit(std::make_shared<const RenderJob>(job), sink, {}).has_value());
  REQUIRE(sink->wait().has_value());
  REQUIRE(sink->frames.size() == 2);
  CHECK(sink->frames[0]->camera == "camera");
  CHECK(sink->frames[1]->camera == "top");
  CHECK(sink->frames[1]->index == 1);
  CHECK(sink->frames[1]->width == 20);
  CHECK(sink->frames[1]->revision == scene->revision);
}

TEST_CASE("engine: a cancelled job ends soon, running or queued") {
  auto engine = make_engine();
  auto job = job_of(still_life().apply(), {Plane::BEAUTY}, 1u << 20);
  job.width = 640;
  job.height = 480;
  const auto endless = std::make_shared<const RenderJob>(job);
  auto running = std::make_shared<Collect>(), queued = std::make_shared<Collect>();
  std::stop_source stop_running, stop_queued;
  REQUIRE(engine->submit(endless, running, stop_running.get_token()).has_value());
  REQUIRE(engine->submit(endless, queued, stop_queued.get_token()).has_value());
  std::this_thread::sleep_for(100ms);
  CHECK(engine->load().jobs == 2);

  auto start = std::chrono::steady_clock::now();
  stop_queued.request_stop();
  CHECK(queued->wait().error().code == Code::kCancelled);
  CHECK(std::chrono::steady_clock::now() - start < 1s);  // 50 ms on a machine of one's own
  start = std::chrono::steady_clock::now();
  stop_running.request_stop();
  CHECK(running->wait().error().code == Code::kCancelled);
  CHECK(std::chrono::steady_clock::now() - start < 1s);
  CHECK(running->frames.empty());
}

TEST_CASE("engine: a job past its deadline ends, and one that is too late does not start") {
  auto engine = make_engine();
  auto job = job_of(still_life().apply(), {Plane::BEAUTY}, 1u << 20);
  job.deadline = std::chrono::steady_clock::now() + 50ms;
  auto late = job;
  auto sink = std::make_shared<Collect>(), second = std::make_shared<Collect>();
  REQUIRE(engine->submit(std::make_shared<const RenderJob>(job), sink, {}).has_value());
  CHECK(sink->wait().error().code == Code::kDeadlineExceeded);
  REQUIRE(engine->submit(std::make_shared<const RenderJob>(late), second, {}).has_value());
  CHECK(second->wait().error().code == Code::kDeadlineExceeded);
  CHECK(second->frames.empty());
  CHECK(second->spent.seconds == 0);
}

TEST_CASE("engine: jobs of two sessions run side by side, and give what they give alone") {
  const auto scene = still_life().apply();
  auto job = job_of(scene, {Plane::BEAUTY, Plane::DEPTH, Plane::VARIANCE}, 200);
  auto other = job;
  other.settings.seed = 8;
  other.origin.session = 2;
  auto engine = make_engine();
  const auto alone = render(*engine, job), other_alone = render(*engine, other);

  auto first = std::make_shared<Collect>(), second = std::make_shared<Collect>();
  REQUIRE(engine->submit(std::make_shared<const RenderJob>(job), first, {}).has_value());
  REQUIRE(engine->submit(std::make_shared<const RenderJob>(other), second, {}).has_value());
  REQUIRE(first->wait().has_value());
  REQUIRE(second->wait().has_value());
  CHECK(same_planes(*first->frames.back(), *alone));
  CHECK(same_planes(*second->frames.back(), *other_alone));
  CHECK(first->spent.samples == 200 * 64 * 48 + 64 * 48);
  CHECK(first->spent.rays == alone->rays);
  CHECK(engine->load().jobs == 0);
  CHECK(engine->load().seconds_a_job > 0);
}

TEST_CASE("engine: a job waits for no other session's, and labels for no beauty") {
  auto engine = make_engine();
  auto endless = job_of(still_life().apply(), {Plane::BEAUTY}, 1u << 20);
  endless.width = 640;
  endless.height = 480;
  std::stop_source stop;
  auto running = std::make_shared<Collect>();
  REQUIRE(engine->submit(std::make_shared<const RenderJob>(endless), running, stop.get_token())
              .has_value());
  render(*engine, job_of(endless.snapshot, {Plane::DEPTH}));  // of the same session
  auto beauty = job_of(endless.snapshot, {Plane::BEAUTY}, 4);
  beauty.origin.session = 2;
  render(*engine, beauty);
  beauty.origin = {.priority = 1};
  render(*engine, beauty);
  CHECK(engine->load().jobs == 1);
  stop.request_stop();
  CHECK(running->wait().error().code == Code::kCancelled);
  CHECK(running->frames.empty());
  CHECK(running->spent.samples > 0);
}

TEST_CASE("engine: what waits when it closes is answered") {
  auto sink = std::make_shared<Collect>(), second = std::make_shared<Collect>();
  {
    auto engine = make_engine();
    const auto job =
        std::make_shared<const RenderJob>(job_of(still_life().apply(), {Plane::BEAUTY}, 1u << 20));
    REQUIRE(engine->submit(job, sink, {}).has_value());
    REQUIRE(engine->submit(job, second, {}).has_value());
  }
  CHECK(sink->wait().error().code == Code::kUnavailable);
  CHECK(second->wait().error().code == Code::kUnavailable);
}

namespace {

/// Keeps which thread a job ended on.
class ThreadOf final : public JobSink {
 public:
  void progress(const Progress&) override {}
  void frame(std::shared_ptr<const Frame> made) override { frame_ = std::move(made); }
  void done(Status status, const Spent&) override {
    thread = std::this_thread::get_id();
    done_.set_value(std::move(status));
  }
  const Frame& wait() {
    REQUIRE(done_.get_future().get().has_value());
    return *frame_;
  }
  std::thread::id thread;

 private:
  std::shared_ptr<const Frame> frame_;
  std::promise<Status> done_;
};

}  // namespace

TEST_CASE("engine: jobs are spread over devices, and make the same bytes on each") {
  const auto scene = still_life().apply();
  const auto one = make_engine(1);
  const auto two = *Engine::create({.devices = 2, .device = {.threads = 1}});
  CHECK(two->devices() == 2);
  const auto job = [&](u64 seed) {
    RenderJob made = job_of(scene, {Plane::BEAUTY, Plane::DEPTH}, 64);
    made.settings.seed = seed;
    return made;
  };
  std::vector<std::shared_ptr<ThreadOf>> sinks;
  for (u64 seed = 0; seed < 8; ++seed) {
    sinks.push_back(std::make_shared<ThreadOf>());
    REQUIRE(two->submit(std::make_shared<const RenderJob>(job(seed)), sinks.back(), {}));
  }
  std::set<std::thread::id> threads;
  for (u64 seed = 0; seed < 8; ++seed) {
    CHECK(same_planes(sinks[seed]->wait(), *render(*one, job(seed))));
    threads.insert(sinks[seed]->thread);
  }
  CHECK(threads.size() == 2);
}

namespace {

/// Of another client: one who waits for nothing long.
RenderJob small_job() {
  RenderJob job = job_of(still_life().apply(), {Plane::BEAUTY, Plane::DEPTH}, 1);
  job.origin = {.tenant = 2, .session = 2};
  return job;
}

/// Small jobs with a new mesh each that are done before a large one of another tenant is.
u32 done_beside(Engine& engine, const RenderJob& large) {
  auto sink = std::make_shared<Collect>();
  std::atomic<bool> is_done = false;
  REQUIRE(engine.submit(std::make_shared<const RenderJob>(large), sink, {}).has_value());
  std::jthread waits([&] {
    (void)sink->wait();
    is_done = true;
  });
  u32 done = 0;
  for (; done < 3 && !is_done; ++done) render(engine, small_job());
  return is_done ? 0 : done;
}

}  // namespace

TEST_CASE("engine: what another client's job needs first, or is made of it, holds up nobody") {
  const auto engine = make_engine(2);
  render(*engine, small_job());
  RenderJob large =
      job_of(still_life().mesh("more", sphere(700)).object("big", "more", mat4x3(1)).apply(),
             {Plane::BEAUTY}, 1);
  CHECK(done_beside(*engine, large) == 3);

  Edits seen = still_life();
  Camera camera{.width = 1600, .height = 1600, .fx = 900, .fy = 900, .cx = 800, .cy = 800};
  camera.rgb_sensor = RgbSensor{.full_well = 10000, .read_noise = 3, .bits = 12};
  large = job_of(seen.put("camera", PutEntity{.camera = camera}).apply(), {Plane::SENSOR_RGB}, 1);
  CHECK(done_beside(*engine, large) == 3);
}

TEST_CASE("engine: a job that is cancelled while it waits for what others have made ends") {
  const auto engine = make_engine(1);
  const RenderJob large =
      job_of(still_life().mesh("more", sphere(700)).object("big", "more", mat4x3(1)).apply(),
             {Plane::DEPTH});
  auto stays = std::make_shared<Collect>(), ends = std::make_shared<Collect>();
  std::stop_source stop;
  REQUIRE(engine->submit(std::make_shared<const RenderJob>(large), stays, {}).has_value());
  REQUIRE(
      engine->submit(std::make_shared<const RenderJob>(large), ends, stop.get_token()).has_value());
  std::this_thread::sleep_for(20ms);
  CHECK(engine->load().jobs == 2);
  stop.request_stop();
  CHECK(ends->wait().error().code == Code::kCancelled);
  CHECK(engine->load().jobs == 1);
  CHECK(stays->wait().has_value());
}

TEST_CASE("engine: sensors see the same with any number of threads") {
  Camera camera{.width = 64, .height = 48, .fx = 60, .fy = 60, .cx = 32, .cy = 24};
  camera.rgb_sensor = RgbSensor{.full_well = 900, .read_noise = 3, .bits = 8};
  const auto scene = still_life().put("camera", PutEntity{.camera = camera}).apply();
  const auto job = job_of(scene, {Plane::SENSOR_RGB}, 4);
  CHECK(same_planes(*render(*make_engine(1), job), *render(*make_engine(3), job)));
}
