// Glass that splits light by its wavelength.
#include "kernels/bsdf/dispersion.h"
#include "tests/unit/catch.h"
#include "tests/unit/principled.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

constexpr u32 kMany = 1 << 16;

/// Wavelength whose place among all is u [nm], from how far it bends.
double wavelength_at(float u) { return std::sqrt(523655 / (double(spectral_at(u).bend) + 1.5168)); }

MaterialView prism(float dispersion) {
  MaterialView m = standard_material();
  m.constant.base_color = vec3(1);
  m.constant.roughness = 0;
  m.constant.transmission = 1;
  m.constant.dispersion = dispersion;
  return m;
}

}  // namespace

TEST_CASE("dispersion: light of all wavelengths is white, and each has the hue of its place") {
  glm::dvec3 sum(0);
  for (u32 i = 0; i < kMany; ++i) {
    const Spectral s = spectral_at((float(i) + 0.5f) / kMany);
    sum += s.color;
    CHECK(s.color.x + s.color.y + s.color.z == Approx(3).epsilon(1e-5));
    const double nm = wavelength_at((float(i) + 0.5f) / kMany);
    if (nm < 460) CHECK((s.color.z > 2.6f && s.color.y == 0));
    if (nm > 525 && nm < 545) CHECK(s.color.y > 2.9f);
    if (nm > 620) CHECK(s.color.x > 2.9f);
  }
  for (int c = 0; c < 3; ++c) CHECK(sum[c] / kMany == Approx(1).epsilon(1e-4));
}

TEST_CASE("dispersion: the index is Cauchy's through the Abbe number's three lines") {
  // nC - nF of the lines at 656.3 and 486.1 nm is (n - 1) / V; V = 20 / dispersion.
  const float ior = 1.5f, dispersion = 0.5f;
  const auto index_at = [&](double nm) {
    float low = 0, high = 1;  // the bend falls with u
    for (int i = 0; i < 40; ++i) {
      const float middle = 0.5f * (low + high);
      (wavelength_at(middle) < nm ? low : high) = middle;
    }
    return double(dispersed_ior(ior, dispersion, low));
  };
  CHECK(index_at(587.6) == Approx(1.5).margin(1e-5));
  CHECK(index_at(486.1) - index_at(656.3) == Approx(0.5 / 40).epsilon(2e-3));
  CHECK(dispersed_ior(1, 100, 0.2f) == 1);
  CHECK(dispersed_ior(1.01f, 100, 1) == 1);  // never below that of a vacuum
}

TEST_CASE("dispersion: a white furnace stays white, smooth, rough and walled") {
  for (const float roughness : {0.0f, 0.3f}) {
    MaterialView m = prism(3);
    m.constant.roughness = roughness;
    TestScene scene;
    scene.add_instance(scene.add(sphere(24)), scene.add(m));
    scene.set_dome(vec3(1));
    Settings settings = standard_settings(64);
    settings.seed = 5;
    const CameraView camera = look_at({0, 0, 4}, {0, 0, 0}, {8, 8}, 0.28f);
    const vec3 seen = mean_beauty(scene.finish(), camera, settings, 4096);
    for (int c = 0; c < 3; ++c) CHECK(double(seen[c]) == Approx(1).margin(0.012));
  }
}

TEST_CASE("dispersion: a prism shows a narrow lamp by Snell, each wavelength where it belongs") {
  // A wedge of 30 degrees in air, its first face square to the camera's axis: light leaves the
  // second face by asin(n sin 30).
  const double wedge = 30 * kPi / 180;
  const float n = 1.5f, dispersion = 4;
  const auto deviation = [&](float u) {
    return std::asin(double(dispersed_ior(n, dispersion, u)) * std::sin(wedge)) - wedge;
  };
  for (const float u : {0.1f, 0.5f, 0.9f}) {
    TestScene scene;
    const float w = 4, slope = float(std::tan(wedge));
    TestMesh mesh;
    // Corners of the wedge: the front face at z = 0, the back one at z = -1 - x tan(wedge).
    for (const float x : {-0.4f, 0.4f})
      for (const float y : {-w, w})
        for (const float z : {0.0f, -1 - x * slope}) mesh.positions.push_back(vec3(x, y, z));
    mesh.triangles = {{0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}, {0, 2, 3}, {0, 3, 1},
                      {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3}};
    scene.add_instance(scene.add(mesh), scene.add(prism(dispersion)));
    // A lamp far away where this wavelength's light comes from.
    const double angle = deviation(u);
    const double distance = 400, width = 0.004;
    const vec3 place(float(std::sin(angle) * distance), 0, float(-std::cos(angle) * distance));
    scene.add_instance(scene.add(sphere(48)), scene.add(emitter(vec3(1))),
                       pose(mat3(float(width * distance)), place));
    const CameraView camera = look_at({0, 0, 4}, {0, 0, 0}, {4, 4}, 0.0005f);
    Settings settings = standard_settings(64);
    const vec3 seen = mean_beauty(scene.finish(), camera, settings, 4096);
    // Wavelengths within the lamp's width, by their colours, less what both faces reflect.
    glm::dvec3 expected(0);
    for (u32 i = 0; i < kMany; ++i) {
      const float at = (float(i) + 0.5f) / kMany;
      if (std::fabs(deviation(at) - angle) < std::asin(width)) expected += spectral_at(at).color;
    }
    expected *= 0.9 / kMany;
    CAPTURE(u, seen.x, seen.y, seen.z, expected.x, expected.y, expected.z);
    for (int c = 0; c < 3; ++c)
      CHECK(double(seen[c]) == Approx(expected[c]).epsilon(0.1).margin(0.01));
  }
}
