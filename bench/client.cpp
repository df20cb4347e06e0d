// Costs of the C++ client: latency of edits and frames, edits and transforms per second, bytes of
// frames per second. usage: bench_client [ADDRESS]   (default: a private daemon)
#include <heliograph/heliograph.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <vector>

namespace hg = heliograph::client;
using Clock = std::chrono::steady_clock;

namespace {

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Prints median and 99th percentile of `count` calls, milliseconds.
void latency(const char* what, int count, const std::function<void(int)>& call) {
  std::vector<double> times;
  for (int i = 0; i < count / 10; ++i) call(i);
  for (int i = 0; i < count; ++i) {
    const auto start = Clock::now();
    call(i);
    times.push_back(1e3 * seconds_since(start));
  }
  std::sort(times.begin(), times.end());
  std::printf("%-34s %8.3f ms median %8.3f ms p99\n", what, times[times.size() / 2],
              times[times.size() * 99 / 100]);
}

struct World {
  hg::Scene scene;
  hg::Entity ball;
  hg::Entity camera;
  hg::Group many;
};

World build(hg::Client& client) {
  hg::Scene scene = client.create_scene();
  hg::Transaction edit = scene.edit();
  const hg::Mesh mesh = edit.mesh("mesh", hg::shapes::cube());
  const hg::Entity ball = edit.entity("cube", hg::Components().mesh(mesh));
  const hg::Entity camera =
      edit.entity("camera", hg::Components()
                                .camera(hg::Camera::from_fov(hg::degrees(50), 16, 16))
                                .transform(hg::look_at({0, -3, 0}, {0, 0, 0})));
  const std::vector<hg::Mat4f> poses(10000, hg::Mat4f::identity());
  const hg::Group many = edit.instances("many", poses, hg::Components());
  edit.commit();
  return {scene, ball, camera, many};
}

hg::Transaction move(World& world, int i) {
  hg::Transaction edit = world.scene.edit();
  edit.update(world.ball, hg::Components().transform(hg::Vec3{0.001 * (i % 7), 0, 0}));
  return edit;
}

void latencies(World& world) {
  latency("edit, acknowledged", 5000, [&](int i) { move(world, i).commit(); });
  latency("a question (revision)", 3000, [&](int) { (void)world.scene.revision(); });
  const auto tiny = hg::RenderOptions().planes({"depth"}).labels({false});
  latency("frame 16x16 depth", 2000, [&](int) { (void)world.scene.render(world.camera, tiny); });
  latency("edit and frame 16x16 depth", 1000, [&](int i) {
    const auto revision = move(world, i).commit();
    (void)world.scene.render(world.camera, hg::RenderOptions(tiny).revision(revision));
  });
}

void rates(World& world) {
  constexpr int kEdits = 20000;
  auto start = Clock::now();
  std::vector<hg::Receipt> receipts;
  for (int i = 0; i < kEdits; ++i) receipts.push_back(move(world, i).commit_later());
  for (hg::Receipt& receipt : receipts) receipt.wait();
  std::printf("%-34s %8.0f /s\n", "edits, pipelined", kEdits / seconds_since(start));

  const std::vector<hg::Mat4f> poses(world.many.size(), hg::Mat4f::identity());
  const hg::Array packed = hg::Array::borrow(poses.data(), {poses.size()});
  constexpr int kBatches = 200;
  start = Clock::now();
  receipts.clear();
  for (int i = 0; i < kBatches; ++i) {
    hg::Transaction edit = world.scene.edit();
    edit.set_transforms(world.many, packed);
    receipts.push_back(edit.commit_later());
  }
  for (hg::Receipt& receipt : receipts) receipt.wait();
  std::printf("%-34s %8.2f million/s\n", "transforms, 10,000 a message",
              1e-6 * kBatches * double(poses.size()) / seconds_since(start));
}

/// Bytes of a frame over the time that is not rendering.
void throughput(World& world, std::uint32_t width, std::uint32_t height) {
  const auto options = hg::RenderOptions()
                           .size(width, height)
                           .planes({"position", "position_camera", "normal", "uv", "depth"})
                           .labels({false});
  std::vector<double> rates;
  double megabytes = 0;
  for (int i = 0; i < 9; ++i) {
    const auto start = Clock::now();
    const hg::Frame frame = world.scene.render(world.camera, options);
    const double seconds = seconds_since(start) - frame.info().render_seconds;
    megabytes = 0;
    for (const hg::Plane& plane : frame.planes()) megabytes += 1e-6 * double(plane.pixels.bytes());
    rates.push_back(1e-3 * megabytes / seconds);
  }
  std::sort(rates.begin(), rates.end());
  std::printf("frame of %7.1f MB by stream %17.2f GB/s median %8.2f best\n", megabytes,
              rates[rates.size() / 2], rates.back());
}

}  // namespace

int main(int argc, char** argv) try {
  hg::LaunchOptions quiet;
  quiet.arguments = {"--log-level", "warning"};
  hg::Client client = argc > 1 ? hg::connect(argv[1]) : hg::launch(quiet);
  World world = build(client);
  latencies(world);
  rates(world);
  throughput(world, 416, 416);
  throughput(world, 1664, 1664);
} catch (const hg::ClientError& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
