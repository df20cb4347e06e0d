// The scene of tests/integration/test_cpp_client.py, scripted in C++; writes every plane as it is.
// usage: same_scene ADDRESS OUT_FOLDER PLANE...
#include <heliograph/heliograph.h>

#include <fstream>
#include <iostream>

namespace hg = heliograph::client;

namespace {

hg::Array checks() {
  std::vector<std::uint8_t> texels;
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x)
      for (int c = 0; c < 3; ++c)
        texels.push_back(std::uint8_t((x / 4 + y / 4) % 2 == 0 ? 230 - 40 * c : 30 + 15 * c));
  return {std::move(texels), {16, 16, 3}};
}

void build(hg::Scene& scene) {
  hg::Transaction edit = scene.edit();
  edit.categories({"ball", "box"});
  edit.sample_studio(12);
  const hg::Mesh ball = edit.mesh("ball/mesh", hg::shapes::sphere(0.4, 48));
  edit.mesh("ring/mesh", hg::shapes::torus());
  edit.mesh("box/mesh", hg::shapes::cube(0.3));
  hg::Geometry can = hg::shapes::cylinder(0.2, 0.5, 32);
  can.keypoints["top"] = {0, 0, 0.25};
  edit.mesh("can/mesh", can);
  hg::Image picture;
  picture.texels = checks();
  picture.filter = hg::Image::Filter::kNearest;
  const hg::Texture texture = edit.texture("checks", picture);
  edit.material("gold", hg::materials::gold());
  edit.material("glass", hg::materials::glass());
  hg::TextureUse use(texture);
  use.factor = {0.9, 0.8, 0.7};
  edit.material("checked", hg::Parameters().base_color(use).roughness(0.4).clearcoat(0.5));
  edit.entity("ball", hg::Components().mesh(ball).material("gold").category("ball").transform(
                          hg::Vec3{-0.5, 0.1, 0.4}));
  edit.entity("ring",
              hg::Components()
                  .mesh("ring/mesh")
                  .material("glass")
                  .label(7)
                  .transform(hg::Pose::euler({0.6, -0.4, 0.35}, {0.3, 0.5, 0.7}, {0.8, 0.8, 0.8})));
  edit.entity("can", hg::Components()
                         .mesh("can/mesh")
                         .material("checked")
                         .category("can")
                         .transform(hg::Pose::wxyz({0.5, 0.6, 0.3}, {0.9, 0.1, 0.2, 0.3})));
  std::vector<hg::Pose> poses;
  for (int i = 0; i < 5; ++i)
    poses.push_back(hg::Pose::xyzw({-1 + 0.5 * i, -0.9, 0.15}, {0, 0, 0.1 * i, 1}));
  edit.instances("box", poses,
                 hg::Components().mesh("box/mesh").material("checked").category("box"));
  hg::Light lamp = hg::Light::of(300, hg::Light::Unit::kLumen);
  lamp.shape = hg::Light::Shape::kRectangle;
  lamp.width = 0.5;
  lamp.height = 0.25;
  lamp.temperature = 3200;
  edit.entity("lamp", hg::Components().light(lamp).light_group("lamp").transform(
                          hg::look_at({0, -1, 2}, {0, 0, 0})));
  hg::Camera lens = hg::Camera::from_fov(hg::degrees(47), 160, 120);
  lens.distortion = {-0.1, 0.02, 0.001, -0.002};
  edit.entity("camera",
              hg::Components().camera(lens).transform(hg::look_at({1.2, -2.9, 1.6}, {0, 0, 0.3})));
  edit.commit();

  hg::Transaction move = scene.edit();
  move.advance(1.0 / 24);
  move.update("ball", hg::Components().transform(hg::Vec3{-0.45, 0.12, 0.42}));
  move.commit();
}

void write(const std::string& path, const hg::Array& array) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(array.data()), std::streamsize(array.bytes()));
}

}  // namespace

int main(int argc, char** argv) try {
  hg::Client client = hg::connect(argv[1]);
  hg::Scene scene = client.create_scene();
  build(scene);
  const std::string folder = std::string(argv[2]) + "/";
  hg::Labels labels;
  labels.amodal = labels.amodal_masks = labels.keypoints = true;
  const hg::Frame frame = scene.render(
      "camera",
      hg::RenderOptions().planes({argv + 3, argv + argc}).spp(8).seed(5).labels(labels).hold(true));
  for (const hg::Plane& plane : frame.planes()) write(folder + plane.name + ".raw", plane.pixels);
  for (const auto& column : frame.labels().all())
    if (column.texts.empty()) write(folder + "labels." + column.name + ".raw", column.values);
  scene.save(folder + "scene.helio");
} catch (const hg::ClientError& error) {
  std::cerr << error.what() << "\n";
  return 1;
}
