// Boxes, visibility and masks of every instance, checked against each other.
// usage: labels [ADDRESS]
#include <heliograph/heliograph.h>

#include <array>
#include <iostream>
#include <string>

namespace hg = heliograph::client;

hg::Entity build(hg::Scene& scene) {
  hg::Transaction edit = scene.edit();
  edit.sample_studio();
  hg::Geometry post = hg::shapes::cylinder(0.15, 1.4);
  post.keypoints["top"] = {0, 0, 0.7};
  edit.mesh("post", post);
  edit.mesh("ball", hg::shapes::sphere(0.4));
  edit.material("clay", hg::Parameters().base_color({0.65, 0.25, 0.15}).roughness(0.8));
  for (int i = 0; i < 3; ++i)  // names serve as well as handles
    edit.entity("ball/" + std::to_string(i), hg::Components()
                                                 .mesh("ball")
                                                 .material("clay")
                                                 .transform(hg::Vec3{0.7 * (i - 1), 0, 0.4})
                                                 .category("ball"));
  edit.entity("post/0",
              hg::Components().mesh("post").transform(hg::Vec3{0.25, -0.7, 0.7}).category("post"));
  const hg::Entity camera =
      edit.entity("camera", hg::Components()
                                .camera(hg::Camera::from_fov(hg::degrees(42), 480, 360))
                                .transform(hg::look_at({0.5, -3.4, 1.4}, {0, 0, 0.5})));
  edit.commit();
  return camera;
}

int main(int argc, char** argv) try {
  hg::Client client = argc > 1 ? hg::connect(argv[1]) : hg::launch();
  hg::Scene scene = client.create_scene("labels");
  const hg::Entity camera = build(scene);

  hg::Labels labels;
  labels.amodal = labels.amodal_masks = labels.keypoints = true;
  const hg::Frame frame =
      scene.render(camera, hg::RenderOptions().planes({"instance", "depth"}).labels(labels));

  const auto ids = frame.plane<std::uint32_t>("instance");
  const auto label = frame.labels().view<std::uint32_t>("label");
  const auto box = frame.labels().view<std::array<std::int32_t, 4>>("bbox_visible");
  const auto share = frame.labels().view<float>("visibility");
  for (std::size_t i = 0; i < label.size(); ++i) {
    const hg::Array mask = frame.amodal_mask(label[i]);
    const auto whole = mask.view<std::uint8_t>();
    int visible = 0;
    int strays = 0;  // outside their box or their own silhouette: none
    for (std::uint32_t y = 0; y < frame.height(); ++y)
      for (std::uint32_t x = 0; x < frame.width(); ++x) {
        if (ids(y, x) != label[i]) continue;
        const auto [x0, y0, x1, y1] = box[i];
        const bool in_box = int(x) >= x0 && int(x) < x1 && int(y) >= y0 && int(y) < y1;
        ++visible;
        strays += !in_box || whole(y, x) == 0;
      }
    std::cout << frame.labels().texts("name")[i] << ": " << visible << " pixels, "
              << int(100 * share[i] + 0.5f) << " % visible, " << strays << " strays\n";
    if (strays != 0) return 1;
  }
} catch (const hg::ClientError& error) {
  std::cerr << error.what() << "\n";
  return 1;
}
