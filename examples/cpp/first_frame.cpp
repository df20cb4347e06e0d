// The shortest way from nothing to a picture. usage: first_frame [OUT.ppm]
#include <heliograph/heliograph.h>

#include <iostream>

namespace hg = heliograph::client;

int main(int argc, char** argv) try {
  hg::Client client =
      hg::launch();  // a private daemon; hg::connect("unix:///...") to one that runs
  hg::Scene scene = client.create_scene("hello");

  hg::Transaction edit = scene.edit();  // one atomic transaction
  edit.sample_studio();                 // the bundled dome and floor
  hg::Mesh ball = edit.mesh("ball/mesh", hg::shapes::sphere(0.5));
  hg::Material gold = edit.material("gold", hg::materials::gold());
  edit.entity(
      "ball",
      hg::Components().mesh(ball).material(gold).transform(hg::Vec3{0, 0, 0.5}).category("ball"));
  hg::Camera lens = hg::Camera::from_fov(hg::degrees(40), 640, 480);
  hg::Entity camera = edit.entity("camera", hg::Components().camera(lens).transform(
                                                hg::look_at({1.6, -2.6, 1.5}, {0, 0, 0.45})));
  edit.commit();

  hg::Frame frame = scene.render(camera, hg::RenderOptions().spp(32).planes({"beauty", "depth"}));
  frame.save(argc > 1 ? argv[1] : "first_frame.ppm");
  std::cout << "the middle is " << frame.plane<float>("depth")(240, 320) << " m away\n";
} catch (const hg::ClientError& error) {
  std::cerr << error.what() << "\n";
  return 1;
}
