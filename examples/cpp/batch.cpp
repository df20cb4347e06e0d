// Training data: each job moves the block and the light in an overlay of its own, several jobs in
// flight. Prints each picture's labels. usage: batch [ADDRESS [JOBS]]
#include <heliograph/heliograph.h>

#include <cmath>
#include <cstdlib>
#include <iostream>

namespace hg = heliograph::client;

int main(int argc, char** argv) try {
  hg::Client client = argc > 1 ? hg::connect(argv[1]) : hg::launch();
  const int count = argc > 2 ? std::atoi(argv[2]) : 8;
  hg::Scene scene = client.create_scene();
  hg::Transaction edit = scene.edit();
  edit.sample_studio();
  const hg::Mesh cube = edit.mesh("cube", hg::shapes::cube(0.4));
  const hg::Entity block = edit.entity(
      "block", hg::Components().mesh(cube).category("block").transform(hg::Vec3{0, 0, 0.2}));
  const hg::Entity camera =
      edit.entity("camera", hg::Components()
                                .camera(hg::Camera::from_fov(hg::degrees(50), 160, 120))
                                .transform(hg::look_at({0, -2.5, 1.5}, {0, 0, 0.2})));
  edit.commit();

  int made = 0;
  const hg::Jobs jobs = [&]() -> std::optional<hg::Job> {
    if (made == count) return std::nullopt;
    hg::Overlay overlay = scene.overlay();
    const double angle = 0.7 * made;
    overlay.update(block, hg::Components().transform(hg::Pose::euler(
                              {0.5 * std::cos(angle), 0.5 * std::sin(angle), 0.2}, {0, 0, angle})));
    hg::Dome dome;
    dome.intensity = 0.5 + 0.1 * made;
    overlay.dome(dome);
    return hg::Job{{camera},
                   hg::RenderOptions().spp(16).planes({"beauty", "instance"}).overlay(overlay),
                   std::uint64_t(made++)};
  };
  for (const hg::Result& result : scene.render_batch(jobs)) {
    const auto boxes = result.frame().labels().view<std::array<std::int32_t, 4>>("bbox_visible");
    std::cout << "job " << result.tag << ": block at x " << boxes[0][0] << " to " << boxes[0][2]
              << "\n";
  }
} catch (const hg::ClientError& error) {
  std::cerr << error.what() << "\n";
  return 1;
}
