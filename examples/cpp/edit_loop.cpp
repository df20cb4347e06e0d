// A simulation's loop: 200 poses per step in one packed message, sent ahead of the frames, with
// flow. usage: edit_loop [ADDRESS [STEPS]]
#include <heliograph/heliograph.h>

#include <cmath>
#include <cstdlib>
#include <iostream>
#include <vector>

namespace hg = heliograph::client;

constexpr int kSide = 20;
constexpr int kRows = 10;

/// A wave over a field of blocks.
std::vector<hg::Mat4f> poses_at(double time) {
  std::vector<hg::Mat4f> out;
  for (int i = 0; i < kSide * kRows; ++i) {
    const int column = i % kSide;
    const int row = i / kSide;
    hg::Mat4f pose = hg::Mat4f::identity();
    pose(0, 3) = 0.2f * float(column) - 2;
    pose(1, 3) = 0.2f * float(row) - 1;
    pose(2, 3) = float(0.3 + 0.1 * std::sin(4 * time + 0.5 * i));
    out.push_back(pose);
  }
  return out;
}

int main(int argc, char** argv) try {
  hg::Client client = argc > 1 ? hg::connect(argv[1]) : hg::launch();
  const int steps = argc > 2 ? std::atoi(argv[2]) : 5;
  hg::Scene scene = client.create_scene("wave");

  hg::Transaction edit = scene.edit();
  edit.sample_studio();
  const hg::Mesh block = edit.mesh("block/mesh", hg::shapes::cube(0.15));
  const hg::Material paint = edit.material("paint", hg::materials::plastic());
  const hg::Group blocks =
      edit.instances("block", poses_at(0), hg::Components().mesh(block).material(paint));
  const hg::Entity camera =
      edit.entity("camera", hg::Components()
                                .camera(hg::Camera::from_fov(hg::degrees(50), 320, 240))
                                .transform(hg::look_at({0, -4, 2.5}, {0, 0, 0.3})));
  edit.commit();

  const double dt = 1.0 / 30;
  for (int step = 1; step <= steps; ++step) {
    hg::Transaction move = scene.edit();
    move.advance(dt);  // what follows is the state at the new time
    move.set_transforms(blocks, poses_at(step * dt));
    hg::Receipt receipt = move.commit_later();  // on its way while we do something else
    const std::uint64_t revision = receipt.wait();
    const hg::Frame frame = scene.render(
        camera, hg::RenderOptions().revision(revision).planes({"flow_backward", "instance"}));
    double fastest = 0;
    for (const auto& [x, y] : frame.plane<std::array<float, 2>>("flow_backward"))
      fastest = std::max(fastest, std::hypot(double(x), double(y)));
    std::cout << "revision " << revision << ": " << frame.labels()["label"].size()
              << " instances, the fastest moved " << fastest << " pixels\n";
  }
} catch (const hg::ClientError& error) {
  std::cerr << error.what() << "\n";
  return 1;
}
