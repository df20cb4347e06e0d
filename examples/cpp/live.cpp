// A live picture: frames refine until the camera moves on. usage: live [ADDRESS [MOVES]]
#include <heliograph/heliograph.h>

#include <cmath>
#include <cstdlib>
#include <iostream>

namespace hg = heliograph::client;

int main(int argc, char** argv) try {
  hg::Client client = argc > 1 ? hg::connect(argv[1]) : hg::launch();
  const int moves = argc > 2 ? std::atoi(argv[2]) : 5;
  hg::Scene scene = client.create_scene();
  hg::Transaction edit = scene.edit();
  edit.sample_studio();
  const hg::Mesh ball = edit.mesh("ball", hg::shapes::sphere(0.5));
  edit.entity("ball/0", hg::Components().mesh(ball).transform(hg::Vec3{0, 0, 0.5}));
  const hg::Entity camera = edit.entity(
      "camera", hg::Components().camera(hg::Camera::from_fov(hg::degrees(50), 160, 120)));
  edit.commit();

  const auto seen_from = [&](double angle) {
    hg::Overlay overlay = scene.overlay();
    overlay.update(camera, hg::Components().transform(hg::look_at(
                               {3 * std::sin(angle), -3 * std::cos(angle), 1.5}, {0, 0, 0.5})));
    return hg::RenderOptions().spp(64).overlay(overlay).seed(std::uint64_t(1000 * angle));
  };
  hg::Live live = scene.stream({camera}, seen_from(0));
  int move = 0;
  for (const hg::Frame& frame : live) {
    std::cout << "move " << move << ": " << frame.info().samples << " samples\n";
    if (!frame.info().is_final) continue;
    if (++move == moves) break;
    live.update(seen_from(0.2 * move));
  }
} catch (const hg::ClientError& error) {
  std::cerr << error.what() << "\n";
  return 1;
}
