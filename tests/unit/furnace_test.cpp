// Energy: in a furnace every white thing has the furnace's own radiance.
#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

MaterialView white(float roughness, float metallic, float transmission, float specular = 1) {
  MaterialView m = standard_material();
  m.constant.base_color = vec3(1);
  m.constant.roughness = roughness;
  m.constant.metallic = metallic;
  m.constant.transmission = transmission;
  m.constant.specular = specular;
  return m;
}

MaterialView with(MaterialView m, float MaterialValues::* parameter, float value) {
  m.constant.*parameter = value;
  return m;
}

MaterialView sheet(MaterialView m) {
  m.thin_walled = true;
  return m;
}

/// Mean radiance of the picture of a sphere of some material that fills it, under a uniform sky.
float open_furnace(const MaterialView& material) {
  TestScene scene;
  scene.add_instance(scene.add(sphere(24)), scene.add(material));
  scene.set_dome(vec3(1));
  const CameraView camera = look_at({0, 0, 4}, {0, 0, 0}, {8, 8}, 0.28f);
  Settings settings = standard_settings(64);
  settings.seed = 7;
  return mean_beauty(scene.finish(), camera, settings, 1024).y;
}

}  // namespace

TEST_CASE("furnace: a white sphere vanishes before a uniform sky") {
  struct Row {
    const char* name;
    MaterialView material;
    float tolerance;
  };
  const Row rows[] = {
      {"lambert", white(0.5f, 0, 0, 0), 0.002f},
      {"smooth plastic", white(0, 0, 0), 0.01f},
      {"plastic 0.3", white(0.3f, 0, 0), 0.01f},
      {"plastic 0.6", white(0.6f, 0, 0), 0.01f},
      {"plastic 1", white(1, 0, 0), 0.01f},
      {"mirror", white(0, 1, 0), 0.002f},
      {"metal 0.2", white(0.2f, 1, 0), 0.01f},
      {"metal 0.5", white(0.5f, 1, 0), 0.01f},
      {"metal 1", white(1, 1, 0), 0.01f},
      {"glass", white(0, 0, 1), 0.01f},
      {"rough glass 0.2", white(0.2f, 0, 1), 0.01f},
      {"rough glass 0.5", white(0.5f, 0, 1), 0.01f},
      {"rough glass 1", white(1, 0, 1), 0.02f},
      {"mixture", white(0.4f, 0.5f, 0.5f), 0.01f},
      {"brushed metal", with(white(0.5f, 1, 0), &MaterialValues::anisotropic, 0.8f), 0.01f},
      {"clearcoat", with(white(0.6f, 1, 0), &MaterialValues::clearcoat, 1), 0.01f},
      {"sheen", with(white(0.6f, 0, 0), &MaterialValues::sheen, 1), 0.01f},
      {"rough inside", with(white(0, 0, 1), &MaterialValues::transmission_roughness, 0.4f), 0.015f},
      {"rougher inside", with(white(0, 0, 1), &MaterialValues::transmission_roughness, 0.9f),
       0.02f},
      {"sheet", sheet(white(0.3f, 0, 1)), 0.01f}};
  for (const Row& row : rows) {
    INFO(row.name);
    const float got = open_furnace(row.material);
    CHECK(std::fabs(got - 1) <= row.tolerance);
  }
}
