// Frames: planes, labels, passes, cancelling, overlays, big arrays and large frames.
#include <chrono>
#include <cmath>
#include <future>
#include <thread>

#include "fixture.h"

using namespace heliograph::client;
using std::chrono::steady_clock;

TEST_CASE("planes have their dtypes and shapes, labels match pixels") {
  Ball world;
  const Frame frame = world.scene.render(
      world.camera,
      RenderOptions().spp(2).planes({"beauty", "depth", "instance", "normal", "coverage"}));
  CHECK(frame["beauty"].shape() == Shape{48, 64, 4});
  CHECK(frame["depth"].shape() == Shape{48, 64});
  CHECK(frame.plane<float>("depth")(24, 32) == Approx(2.5).margin(0.02));
  CHECK(std::isinf(frame.plane<float>("depth")(0, 0)));
  CHECK(frame.plane<std::array<float, 3>>("normal")(24, 32)[1] == Approx(-1).margin(0.05));
  const auto ids = frame.plane<std::uint32_t>("instance");
  const auto box = frame.labels().view<std::array<std::int32_t, 4>>("bbox_visible")[0];
  std::array<std::int32_t, 4> seen{64, 48, 0, 0};
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 64; ++x)
      if (ids(y, x) == frame.labels().view<std::uint32_t>("label")[0])
        seen = {std::min(seen[0], x), std::min(seen[1], y), std::max(seen[2], x + 1),
                std::max(seen[3], y + 1)};
  CHECK(box == seen);
  CHECK(frame.instances().begin()->second == "ball");
  CHECK(frame.info().K(0, 0) == Approx(world.camera.camera().fx));
  CHECK(frame.info().camera_from_world_cv(2, 3) == Approx(3));
  CHECK(frame.info().categories.at(1) == "ball");
  const ClientError error = error_of([&] { (void)frame["albedo_mean"]; });
  CHECK(error.code() == Code::kNotFound);
  CHECK(error.details().nearest.size() == 5);
  CHECK(error_of([&] { (void)frame.plane<double>("depth"); }).code() == Code::kInvalidArgument);
}

TEST_CASE("planes come as half floats where that is asked for") {
  Ball world;
  const auto options = RenderOptions().spp(2).planes({"beauty", "depth"});
  const Frame whole = world.scene.render(world.camera, options);
  const Frame frame =
      world.scene.render(world.camera, RenderOptions(options).half({"beauty", "depth"}));
  const auto floats = whole.plane<float>("depth");
  const auto halves = frame.plane<Half>("depth");
  CHECK(std::isinf(halves(0, 0).value()));
  for (std::size_t i = 0; i < floats.size(); ++i)
    REQUIRE(halves[i].bits == Half::of(floats[i]).bits);
  const auto seen = frame.image().view<std::uint8_t>(), wanted = whole.image().view<std::uint8_t>();
  for (std::size_t i = 0; i < wanted.size(); ++i) REQUIRE(std::abs(seen[i] - wanted[i]) <= 1);
  const auto wrong = [&] { (void)world.scene.render(world.camera, RenderOptions().half({"uv"})); };
  CHECK(error_of(wrong).details().field == "half");
}

TEST_CASE("several cameras are one job, planes may name a second camera or a group") {
  Ball world;
  Transaction edit = world.scene.edit();
  const Entity right = edit.entity(
      "right",
      Components().camera(world.camera.camera()).transform(look_at({0.1, -3, 0}, {0.1, 0, 0})));
  edit.commit();
  const auto frames = world.scene.render({world.camera, right}, RenderOptions().spp(1));
  CHECK(frames.size() == 2);
  CHECK(frames[1].info().camera == "right");
  const Frame frame = world.scene.render(
      world.camera, RenderOptions().spp(1).planes({"disparity:right", "beauty:"}));
  CHECK(frame.contains("disparity:right"));
  CHECK(frame["disparity"].shape() == Shape{48, 64});
  CHECK(frame["beauty:"].shape() == Shape{48, 64, 3});
}

TEST_CASE("a stereo rig is rectified: disparity is fx times baseline over depth") {
  Ball world;
  Transaction edit = world.scene.edit();
  const Camera lens = Camera::from_fov(degrees(50), 64, 48);
  const Rig rig =
      stereo(edit, "eyes", lens, 0.1, Components().transform(look_at({0, -3, 0}, {0, 0, 0})));
  CHECK(error_of([&] { stereo(edit, "wrong", lens, 0, Components()); }).field() == "baseline");
  edit.commit();
  const Frame frame = world.scene.render(
      rig.left, RenderOptions().planes({"disparity:eyes/right", "depth", "instance"}));
  const auto depth = frame.plane<float>("depth");
  const auto disparity = frame.plane<float>("disparity");
  const double scale = frame.info().K(0, 0) * 0.1;
  CHECK(disparity(24, 32) == Approx(scale / depth(24, 32)).epsilon(1e-4));
  CHECK(rig.right.world_transform()(0, 3) == Approx(0.05));
}

TEST_CASE("a frame outlives its scene and its client") {
  View<float> depth = Array(std::vector<float>()).view<float>();
  {
    Client own = connect(client().address());
    Scene scene = own.create_scene();
    Transaction edit = scene.edit();
    const Entity camera = edit.entity(
        "camera", Components().camera(Camera::orthographic(10, 8, 8)).transform(Pose()));
    edit.commit();
    depth = scene.render(camera, RenderOptions().planes({"depth"})).plane<float>("depth");
  }
  CHECK(depth.shape() == Shape{8, 8});
  CHECK(std::isinf(depth(7, 7)));
}

TEST_CASE("a manifest renders the same bytes, an overlay changes a frame but not the scene") {
  Ball world;
  const auto options = RenderOptions().spp(4).seed(7);
  const Frame first = world.scene.render(world.camera, options);
  const Frame again = world.scene.rerender(first.info().manifest);
  const auto a = first.plane<float>("beauty");
  const auto b = again.plane<float>("beauty");
  CHECK(std::equal(a.begin(), a.end(), b.begin(), b.end()));
  Overlay overlay = world.scene.overlay();
  overlay.update(world.ball, Components().visible(false));
  const auto depth = RenderOptions(options).planes({"depth"}).overlay(overlay);
  for (int i = 0; i < 2; ++i)
    CHECK(std::isinf(world.scene.render(world.camera, depth).plane<float>("depth")(24, 32)));
  CHECK(world.ball.visible());
  CHECK(error_of([&] { (void)world.scene.rerender("{}"); }).field() == "manifest");
}

TEST_CASE("progressive passes and progress are told while the job runs") {
  Ball world;
  std::vector<std::uint32_t> samples;
  int told = 0;
  const Frame last = world.scene.render(world.camera, RenderOptions()
                                                          .spp(4096)
                                                          .on_pass([&](const Frame& frame) {
                                                            samples.push_back(frame.info().samples);
                                                          })
                                                          .progress([&](const Progress& progress) {
                                                            CHECK(progress.done <= 1);
                                                            ++told;
                                                          }));
  CHECK(samples.back() == last.info().samples);
  CHECK(std::is_sorted(samples.begin(), samples.end()));
  CHECK(told > 0);
  const auto stop = RenderOptions().spp(1 << 20).on_pass([](const Frame&) { throw 42; });
  CHECK_THROWS_AS((void)world.scene.render(world.camera, stop), int);
}

TEST_CASE("a cancelled render ends at once, a late one by its timeout; the client stays usable") {
  Ball world(640, 480);
  const Cancellation cancellation;
  const auto endless = RenderOptions().spp(1 << 20);
  const auto start = steady_clock::now();
  auto job = std::async(std::launch::async, [&] {
    return error_of([&] {
      (void)world.scene.render(world.camera, RenderOptions(endless).cancellation(cancellation));
    });
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  cancellation.cancel();
  CHECK(job.get().code() == Code::kCancelled);
  CHECK(error_of([&] {
          (void)world.scene.render(world.camera, RenderOptions(endless).timeout(0.1));
        }).code() == Code::kDeadlineExceeded);
  CHECK(error_of([&] {  // cancelled before it began
          (void)world.scene.render(world.camera, RenderOptions(endless).cancellation(cancellation));
        })
            .code() == Code::kCancelled);
  CHECK(steady_clock::now() - start < std::chrono::seconds(5));
  CHECK(world.scene.render(world.camera, RenderOptions().spp(1)).info().samples == 1);
}

TEST_CASE("arrays above 1 MiB are uploaded, by hash once, and read back whole") {
  Ball world;
  std::vector<std::array<float, 3>> positions;
  std::vector<std::array<std::uint32_t, 3>> indices;
  for (std::uint32_t i = 0; i < 100000; ++i) {  // 3.6 MB and 1.2 MB
    for (int corner = 0; corner < 3; ++corner)
      positions.push_back({float(corner == 1), float(i), float(corner == 2)});
    indices.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  Geometry geometry;
  geometry.positions = positions;
  geometry.indices = indices;
  Transaction edit = world.scene.edit();
  const Mesh mesh = edit.mesh("big", geometry);
  const Mesh twin = edit.mesh("twin", geometry);
  edit.commit();
  const auto back = mesh.positions().view<std::array<float, 3>>();
  CHECK(std::equal(positions.begin(), positions.end(), back.begin(), back.end()));
  CHECK(twin.indices().shape() == Shape{100000, 3});
  const std::vector<Mat4f> poses(20000, Mat4f::identity());  // 1.3 MB
  Transaction many = world.scene.edit();
  const Group group = many.instances("many", poses, Components());
  many.commit();
  Transaction move = world.scene.edit();
  move.set_transforms(group, poses);
  move.commit();
  CHECK(group.back().transform()(0, 0) == 1);
}

TEST_CASE("large frames arrive whole") {
  Ball world(2048, 1536);
  const Frame frame =
      world.scene.render(world.camera, RenderOptions().planes({"position", "instance", "depth"}));
  const auto position = frame.plane<std::array<float, 3>>("position");  // 38 MB
  const auto depth = frame.plane<float>("depth");
  const auto ids = frame.plane<std::uint32_t>("instance");
  std::size_t hits = 0;
  for (std::size_t i = 0; i < depth.size(); ++i) {
    const bool is_hit = ids[i] != 0;
    hits += is_hit;
    const bool agrees = is_hit ? std::abs(position[i][1] + 3 - depth[i]) < 1e-3f
                               : std::isnan(position[i][1]) && std::isinf(depth[i]);
    if (!agrees) FAIL("pixel " << i);
  }
  CHECK(hits > 30000);
}
