// RenderBatch and Stream: tags, credits, errors of one item, updates, ends, threads.
#include <atomic>
#include <chrono>
#include <map>
#include <set>
#include <thread>

#include "fixture.h"

using namespace heliograph::client;
using std::chrono::steady_clock;

namespace {

RenderOptions small() { return RenderOptions().spp(2).planes({"beauty", "depth"}).seed(3); }

bool same(const Frame& a, const Frame& b) {
  for (const Plane& plane : a.planes()) {
    const Array& other = b[plane.name];
    if (other.bytes() != plane.pixels.bytes() ||
        !std::equal(other.data(), other.data() + other.bytes(), plane.pixels.data()))
      return false;
  }
  return true;
}

std::vector<Job> jobs_of(const Ball& world, int count) {
  std::vector<Job> jobs;
  for (int i = 0; i < count; ++i)
    jobs.push_back({{world.camera}, small().seed(std::uint64_t(i)), std::uint64_t(100 + i)});
  return jobs;
}

}  // namespace

TEST_CASE("a batch gives each job's frame with its tag, the same bytes as a render") {
  Ball world;
  std::set<std::uint64_t> tags;
  for (const Result& result : world.scene.render_batch(jobs_of(world, 10))) {
    tags.insert(result.tag);
    const auto alone = small().seed(result.tag - 100);
    CHECK(same(result.frame(), world.scene.render(world.camera, alone)));
  }
  CHECK(tags.size() == 10);
  CHECK(*tags.rbegin() == 109);
  CHECK_FALSE(world.scene.render_batch(std::vector<Job>()).next());
}

TEST_CASE("jobs have cameras and overlays of their own; nothing is published") {
  Ball world;
  Overlay hidden = world.scene.overlay();
  hidden.update(world.ball, Components().visible(false));
  std::map<std::uint64_t, Result> found;
  const std::vector<Job> jobs{{{world.camera, world.camera}, small(), 1},
                              {{world.camera}, small().overlay(hidden), 2}};
  for (const Result& result : world.scene.render_batch(jobs)) found[result.tag] = result;
  CHECK(found[1].frames.size() == 2);
  CHECK(same(found[1].frames[0], found[1].frames[1]));
  CHECK(std::isinf(found[2].frame().plane<float>("depth")(24, 32)));
  CHECK(world.scene.revision() == 1);
}

TEST_CASE("one job's error does not end the others, whoever refuses it") {
  Ball world;
  auto jobs = jobs_of(world, 6);
  jobs[1].cameras = {"nobody"};
  jobs[3].options.planes({"nothing"});
  jobs[4].options.timeout(1);
  std::map<std::uint64_t, Result> found;
  for (const Result& result : world.scene.render_batch(jobs, {2, {}, {}}))
    found[result.tag] = result;
  CHECK(found.size() == 6);
  CHECK(found[101].error->code() == Code::kNotFound);
  CHECK(found[101].error->field() == "job.cameras[0]");
  CHECK(found[103].error->field() == "planes");
  CHECK(found[104].error->field() == "timeout");
  CHECK(error_of([&] { (void)found[101].frame(); }).code() == Code::kNotFound);
  for (const int good : {100, 102, 105}) CHECK(found[std::uint64_t(good)].frame().width() == 64);
}

TEST_CASE("jobs are taken as results are, so that they may be endless; close() cancels the rest") {
  Ball world;
  std::atomic<int> taken = 0;
  Results results = world.scene.render_batch(
      [&]() -> std::optional<Job> {
        ++taken;
        return Job{{world.camera}, small()};
      },
      {3, {}, {}});
  for (int i = 0; i < 20; ++i) REQUIRE(results.next());
  CHECK(taken == 3 + 20);
  results.close();
  const ClientError error = error_of([&] {
    while (results.next()) {
    }
  });
  CHECK(error.code() == Code::kCancelled);
  CHECK(world.scene.render(world.camera, small()).width() == 64);
}

TEST_CASE("a batch ends by its timeout or its cancellation; credits are checked") {
  Ball world(640, 480);
  const std::vector<Job> endless{{{world.camera}, RenderOptions().spp(1 << 20)}};
  CHECK(error_of([&] { (void)world.scene.render_batch(endless, {1, 0.2, {}}).next(); }).code() ==
        Code::kDeadlineExceeded);
  const Cancellation cancellation;
  Results results = world.scene.render_batch(endless, {1, {}, cancellation});
  std::thread other([&] { cancellation.cancel(); });
  CHECK(error_of([&] { (void)results.next(); }).code() == Code::kCancelled);
  other.join();
  CHECK(error_of([&] { (void)world.scene.render_batch(endless, {0, {}, {}}); }).field() ==
        "credits");
  CHECK(error_of([&] { (void)world.scene.render_batch(endless, {9999, {}, {}}).next(); }).field() ==
        "credits");
}

TEST_CASE("a lossless stream gives the final frame of each update, in order, and ends") {
  Ball world;
  Live live = world.scene.stream({world.camera}, small(), Policy::kLossless);
  live.update(live.options().seed(4));
  live.update({world.camera}, live.options().size(32, 24));
  live.finish();
  std::vector<Frame> frames;
  for (const Frame& frame : live) frames.push_back(frame);
  REQUIRE(frames.size() == 3);
  CHECK(same(frames[0], world.scene.render(world.camera, small())));
  CHECK(same(frames[1], world.scene.render(world.camera, small().seed(4))));
  CHECK(frames[2].width() == 32);
  for (const Frame& frame : frames) CHECK(frame.info().is_final);
  CHECK_FALSE(live.next());
}

TEST_CASE("the latest stream refines, follows edits and updates, and stops at close()") {
  Ball world;
  Live live = world.scene.stream({world.camera}, small().spp(64));
  std::optional<Frame> frame = live.next();
  REQUIRE(frame);
  CHECK(frame->info().samples < 64);
  while (!frame->info().is_final) frame = live.next();
  CHECK(frame->info().samples == 64);
  Transaction move = world.scene.edit();
  move.update(world.ball, Components().visible(false));
  const std::uint64_t revision = move.commit();
  frame = live.next();
  while (frame->revision() < revision) frame = live.next();
  CHECK(std::isinf(frame->plane<float>("depth")(24, 32)));
  std::thread other([&] { live.update(live.options().seed(9)); });
  while (frame->info().seed != 9) frame = live.next();
  other.join();
  live.close();
  CHECK(error_of([&] {
          while (live.next()) {
          }
        }).code() == Code::kCancelled);
}

TEST_CASE("many updates while nobody reads cost nothing and come out in order") {
  Ball world;
  Live live = world.scene.stream({world.camera}, small(), Policy::kLossless);
  for (std::uint64_t i = 1; i <= 50; ++i) live.update(small().seed(1000 + i));
  live.finish();
  std::vector<std::uint64_t> seeds;
  for (const Frame& frame : live) seeds.push_back(frame.info().seed);
  REQUIRE(seeds.size() == 51);
  CHECK(seeds.front() == 3);
  CHECK(std::is_sorted(seeds.begin() + 1, seeds.end()));
  CHECK(seeds.back() == 1050);
}

TEST_CASE("what a stream cannot do is refused by its name; the client stays usable") {
  Ball world;
  const auto refused = [&](const RenderOptions& options) {
    return error_of([&] { (void)world.scene.stream({world.camera}, options); }).field();
  };
  CHECK(refused(small().on_pass([](const Frame&) {})) == "on_pass");
  CHECK(refused(small().progress([](const Progress&) {})) == "progress");
  CHECK(refused(small().planes({"nothing"})) == "planes");
  Live live = world.scene.stream({"nobody"}, small());
  const ClientError error = error_of([&] { (void)live.next(); });
  CHECK(error.code() == Code::kNotFound);
  CHECK(error.field() == "settings.cameras[0]");
  CHECK_FALSE(live.next());
  const auto start = steady_clock::now();
  Ball large(640, 480);
  {
    Live left = large.scene.stream({large.camera}, RenderOptions().spp(1 << 20));
  }
  CHECK(steady_clock::now() - start < std::chrono::seconds(5));
  CHECK(world.scene.render(world.camera, small()).width() == 64);
}
