// usage: robot ADDRESS [TOKEN [CA [CERT KEY]]]; prints the depth in the middle of a picture.
#include <heliograph/heliograph.h>

#include <iostream>

namespace hg = heliograph::client;

/// The arguments after the address; files of certificates mean TLS.
hg::ConnectOptions options_of(int argc, char** argv) {
  hg::ConnectOptions options;
  if (argc > 2) options.token = argv[2];
  if (argc < 4) return options;
  options.tls.emplace();
  options.tls->ca = argv[3];
  if (argc > 5) {
    options.tls->cert = argv[4];
    options.tls->key = argv[5];
  }
  return options;
}

int main(int argc, char** argv) try {
  hg::Client client = hg::connect(argv[1], options_of(argc, argv));
  hg::Scene scene = client.create_scene();
  hg::Transaction edit = scene.edit();
  edit.entity("wall", hg::Components().mesh(edit.mesh("", hg::shapes::plane(4))));
  const hg::Entity camera = edit.entity(
      "camera",
      hg::Components().camera(hg::Camera::orthographic(10, 9, 9)).transform(hg::Vec3{0, 0, 2.5}));
  edit.commit();
  const hg::Frame frame = scene.render(camera, hg::RenderOptions().planes({"depth"}));
  std::cout << frame.plane<float>("depth")(4, 4) << "\n";
} catch (const hg::ClientError& error) {
  std::cerr << name_of(error.code()) << ": " << error.what() << "\n";
  return 1;
}
