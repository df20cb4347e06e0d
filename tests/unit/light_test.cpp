// Emission and the choice of directions to it, against densities and closed forms.
#include "kernels/light/light.h"

#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

/// A point in a medium: every direction counts alike.
Receiver from(const SceneView& view, vec3 p) {
  return receiver_at(view, p, vec3(0), Facing::kAny, 0);
}

vec3 sky_at(const SceneView& view, vec3 d) {
  return dome_radiance(view, dome_place(view.dome, d).uv);
}

/// A picture with a sun, negative and NaN texels.
std::vector<float> sky(u32 width, u32 height) {
  std::vector<float> texels(size_t(width) * height * 3);
  for (u32 y = 0; y < height; ++y) {
    for (u32 x = 0; x < width; ++x) {
      float* t = &texels[(size_t(y) * width + x) * 3];
      t[0] = 0.2f + 0.1f * float(x) / float(width);
      t[1] = 0.3f;
      t[2] = 0.5f * float(height - y) / float(height);
    }
  }
  for (int c = 0; c < 3; ++c) texels[(size_t(height / 4) * width + width / 3) * 3 + c] = 50;
  texels[size_t(width) * 3 * 5] = NAN;
  texels[size_t(width) * 3 * 6 + 1] = -7;
  return texels;
}

}  // namespace

TEST_CASE("light: directions to a stretched, mirrored mesh follow their density (1e-6)") {
  TestScene scene;
  MaterialView m = emitter(vec3(1));
  m.two_sided_emission = true;
  const mat3 linear = rotation({1, 2, 3}, 0.7f) * mat3(3, 0, 0, 0, -0.5f, 0, 0, 0, 1);
  const u32 i =
      scene.add_instance(scene.add(sphere(3, false)), scene.add(m), pose(linear, {0.5f, 1, 4}));
  scene.add_light(i);
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  // Every surface along a direction could have been sampled: the density is their sum.
  const auto density = [&](double x, double y) {
    const double z = y, r = std::sqrt(1 - z * z), phi = 2 * M_PI * x;
    const vec3 d(r * std::cos(phi), r * std::sin(phi), z);
    Ray ray{vec3(0), d, INFINITY, 0, {}};
    double sum = 0;
    float t = 0;
    for (;;) {
      Hit hit = tracer.closest(ray, kAllRays);
      if (hit.instance == kNone) break;
      t += hit.t;
      hit.t = t;
      sum += double(light_pdf(view, from(view, vec3(0)), hit, d, 0));
      ray.origin = d * (t + 1e-4f);
      t += 1e-4f;
    }
    return 2 * M_PI * sum;
  };
  Random random;
  const auto sample = [&](double& x, double& y) {
    LightSample s;
    if (!sample_light(view, from(view, vec3(0)), random.next2(), s)) return false;
    x = std::atan2(double(s.direction.y), double(s.direction.x)) / (2 * M_PI);
    if (x < 0) x += 1;
    y = s.direction.z;
    return y > 0;
  };
  CHECK(square_p_value({12, 64, 20000}, sample, density) > kLevel);
}

TEST_CASE(
    "light: with triangles of unlike brightness samples still measure the solid angle (2 %)") {
  for (const vec3 at : {vec3(0.32f, 0.05f, 0.32f), vec3(0.65f, 0.1f, 0.62f)}) {
    TestScene scene;
    scene.triangle_radiosity = [](u32 triangle) { return triangle % 3 == 0 ? 5.0f : 0.5f; };
    const u32 i = scene.add_instance(scene.add(sphere(4, false)), scene.add(emitter(vec3(1))),
                                     pose(rotation({1, 2, 3}, 1) * 0.3f, at));
    scene.add_light(i);
    const SceneView& view = scene.finish();
    const TestTracer tracer(view);
    const Receiver receiver = receiver_at(view, vec3(0), vec3(0, 0, 1), Facing::kFront, 0);
    const auto met = [&](vec3 d) {
      return tracer.closest({vec3(0), d, INFINITY, 0, {}}, kAllRays);
    };
    const int steps = 500;
    double solid_angle = 0;
    for (int j = 0; j < steps * steps; ++j) {
      const int row = j / steps;
      const double y = (row + 0.5) / steps, phi = 2 * M_PI * (j % steps + 0.5) / steps;
      const double r = std::sqrt(1 - y * y);
      if (met(vec3(r * std::cos(phi), r * std::sin(phi), y)).instance != kNone)
        solid_angle += 2 * M_PI / (double(steps) * steps);
    }
    Random random;
    const int count = 50000;
    double sum = 0;
    int bright = 0, same = 0, found = 0;
    for (int j = 0; j < count; ++j) {
      LightSample s;
      if (!sample_light(view, receiver, random.next2(), s)) continue;
      const Hit hit = met(s.direction);
      if (hit.instance == kNone) continue;  // a seam
      ++found;
      sum += 1 / double(s.pdf);
      bright += s.primitive % 3 == 0;
      same += light_pdf(view, receiver, hit, s.direction, 0) == Approx(s.pdf).epsilon(2e-3);
    }
    CHECK(sum / count == Approx(solid_angle).epsilon(0.02));
    CHECK(same > 0.99 * found);
    CHECK(bright > 0.6 * found);
  }
}

TEST_CASE("light: a near rectangle is sampled by solid angle (1e-6)") {
  TestScene scene;
  const u32 i = scene.add_instance(scene.add(rectangle(1, 0.6f)), scene.add(emitter(vec3(1))),
                                   pose(rotation({1, 0, 0}, kPi), {0.3f, 0.1f, 0.4f}));
  scene.add_light(i);
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  const Receiver receiver = receiver_at(view, vec3(0), vec3(0, 0, 1), Facing::kFront, 0);
  float least = INFINITY, most = 0;
  const auto density = [&](double x, double y) {
    const double z = y, r = std::sqrt(1 - z * z), phi = 2 * M_PI * x;
    const vec3 d(r * std::cos(phi), r * std::sin(phi), z);
    const Hit hit = tracer.closest({vec3(0), d, INFINITY, 0, {}}, kAllRays);
    if (hit.instance == kNone) return 0.0;
    const float pdf = light_pdf(view, receiver, hit, d, 0);
    least = min2(least, pdf);
    most = max2(most, pdf);
    return 2 * M_PI * double(pdf);
  };
  Random random;
  const auto sample = [&](double& x, double& y) {
    LightSample s;
    if (!sample_light(view, receiver, random.next2(), s)) return false;
    x = std::atan2(double(s.direction.y), double(s.direction.x)) / (2 * M_PI);
    if (x < 0) x += 1;
    y = s.direction.z;
    return true;
  };
  CHECK(square_p_value({24, 64, 100000}, sample, density) > kLevel);
  CHECK(most == Approx(least).epsilon(1e-5));
}

TEST_CASE("light: the density of a sample is the density of the ray that meets the same point") {
  TestScene scene;
  const u32 mesh = scene.add(rectangle(0.5f, 0.7f));
  const u32 m = scene.add(emitter(vec3(2)));
  for (int i = 0; i < 5; ++i) {
    const mat3 linear = rotation({1, float(i), 0}, 3) * mat3(1 + float(i), 0, 0, 0, 1, 0, 0, 0, 1);
    scene.add_light(scene.add_instance(mesh, m, pose(linear, {3 * float(i), 0, 3})));
  }
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  Random random;
  int seen = 0;
  for (int i = 0; i < 1000; ++i) {
    LightSample s;
    if (!sample_light(view, from(view, {1, 0, 0}), random.next2(), s)) continue;
    const Hit hit = tracer.closest({vec3(1, 0, 0), s.direction, INFINITY, 0, {}}, kAllRays);
    if (hit.instance == kNone) continue;  // a seam
    const u32 light = surface_at(view, hit.instance, hit.primitive, {hit.u, hit.v}, 0).light;
    if (light_pdf(view, from(view, {1, 0, 0}), hit, s.direction, light) ==
        Approx(s.pdf).epsilon(1e-3))
      ++seen;
  }
  CHECK(seen > 950);  // the rest is hidden behind another light
}

TEST_CASE("dome: directions follow their density, which is the one looked up (1e-6)") {
  TestScene scene;
  scene.dome_rotation = rotation({1, 1, 0}, 0.6f);
  scene.set_dome(vec3(1), scene.add_texture(sky(32, 16), {32, 16}, TexelType::kF32));
  const SceneView& view = scene.finish();
  Random random;
  int same = 0;
  const auto sample = [&](double& x, double& y) {
    LightSample s;
    if (!sample_light(view, from(view, vec3(0)), random.next2(), s)) return false;
    const DomePlace place = dome_place(view.dome, s.direction);
    // At the poles u is anything: differences count by their length on the sphere.
    REQUIRE(length((place.uv - s.place) * vec2(place.sine, 1)) < 1e-5f);
    // Rounding may move a direction on the border of two texels into the other one.
    if (std::fabs(texel_pdf(view.dome, place) / s.pdf - 1) < 1e-2f) ++same;
    x = std::atan2(double(s.direction.y), double(s.direction.x)) / (2 * M_PI) + 0.5;
    y = 0.5 + 0.5 * double(s.direction.z);
    return true;
  };
  const auto density = [&](double x, double y) {
    const double z = 2 * y - 1, r = std::sqrt(1 - z * z), phi = 2 * M_PI * (x - 0.5);
    return 4 * M_PI *
           double(texel_pdf(view.dome,
                            dome_place(view.dome, vec3(r * std::cos(phi), r * std::sin(phi), z))));
  };
  CHECK(square_p_value({20, 32, 100000}, sample, density) > kLevel);
  CHECK(same > 99900);
}

TEST_CASE("dome: u = 0.5 - atan2(y, x) / 2 pi, row 0 is +z, rotation") {
  std::vector<float> texels(8 * 4 * 3, 0);
  for (u32 i = 0; i < 32; ++i) texels[i * 3] = float(i);
  TestScene scene;
  scene.dome_rotation = rotation({0, 0, 1}, 0.5f * kPi);
  scene.set_dome(vec3(1), scene.add_texture(texels, {8, 4}, TexelType::kF32));
  const SceneView& view = scene.finish();
  // Centre of texel (x 5, y 1): u = 5.5 / 8, v = 1.5 / 4; then rotated by a quarter turn.
  const double phi = 2 * M_PI * (0.5 - 5.5 / 8) + M_PI / 2, theta = M_PI * 1.5 / 4;
  const vec3 d(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
  CHECK(sky_at(view, d).x == Approx(13).epsilon(1e-4));
  CHECK(sky_at(view, vec3(0, 0, 1)).x < 8);
  CHECK(sky_at(view, vec3(0, 0, -1)).x >= 24);
}

TEST_CASE("dome: irradiance of a plane is the integral over the sky") {
  TestScene scene;
  const std::vector<float> texels = sky(32, 16);
  const u32 texture = scene.add_texture(texels, {32, 16}, TexelType::kF32);
  scene.set_dome(vec3(2), texture);
  scene.add_instance(scene.add(rectangle(100, 100)), scene.add(lambert(vec3(0.5f))));
  const SceneView& view = scene.finish();
  glm::dvec3 irradiance(0);
  const int n = 1500;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const double z = (i + 0.5) / n, r = std::sqrt(1 - z * z), phi = 2 * M_PI * (j + 0.5) / n;
      const vec3 l = sky_at(view, vec3(r * std::cos(phi), r * std::sin(phi), z));
      irradiance += glm::dvec3(l) * z * (2 * M_PI / (double(n) * n));
    }
  }
  const CameraView camera = look_at({0, 0, 5}, {0, 0, 0}, {4, 4}, 0.5f);
  const vec3 got = mean_beauty(view, camera, standard_settings(2), 4096);
  for (int c = 0; c < 3; ++c) CHECK(got[c] == Approx(irradiance[c] * 0.5 / M_PI).epsilon(0.003));
}

TEST_CASE("light: a spherical light's irradiance has its closed form") {
  // E = pi L (R / d)^2 at a point that faces the centre of a whole sphere above its horizon.
  TestScene scene;
  const u32 floor =
      scene.add_instance(scene.add(rectangle(0.01f, 0.01f)), scene.add(lambert(vec3(1))));
  const u32 lamp = scene.add_instance(scene.add(sphere(96, false)), scene.add(emitter(vec3(3))),
                                      pose(mat3(0.5f), {0, 0, 2}));
  scene.instances[lamp].visibility = kAllRays & ~kCameraRay;
  scene.add_light(lamp);
  (void)floor;
  const SceneView& view = scene.finish();
  const CameraView camera = look_at({0.5f, 0, 0.5f}, {0, 0, 0}, {4, 4}, 0.005f);
  const vec3 got = mean_beauty(view, camera, standard_settings(2), 4096);
  // The tessellated sphere has the solid angle of its silhouette, a little below the sphere's.
  CHECK(got.y == Approx(3 * 0.25 / 4).epsilon(0.005));
}

TEST_CASE("light: only the front emits unless two-sided; a mirroring pose keeps the outside") {
  for (const bool mirrored : {false, true}) {
    for (const bool two_sided : {false, true}) {
      for (const bool above : {false, true}) {
        INFO("mirrored " << mirrored << " two-sided " << two_sided << " above " << above);
        TestScene scene;
        MaterialView m = emitter(vec3(1));
        m.two_sided_emission = two_sided;
        const mat3 linear(mirrored ? -1 : 1, 0, 0, 0, 1, 0, 0, 0, 1);
        const u32 lamp =
            scene.add_instance(scene.add(rectangle(1, 1)), scene.add(m), pose(linear, {0, 0, 2}));
        scene.add_light(lamp);
        const SceneView& view = scene.finish();
        LightSample s;
        const bool found =
            sample_light(view, from(view, {0, 0, above ? 4.0f : 0.0f}), {0.4f, 0.6f}, s);
        CHECK(found == (above || two_sided));
        const Surface surface = surface_at(view, lamp, 0, {0.3f, 0.3f}, 0);
        CHECK(surface.ng.z == Approx(1));
      }
    }
  }
}

TEST_CASE("light: a textured entity light multiplies its radiance, alpha thins it") {
  TestScene scene;
  const u32 texture = scene.add_texture(std::vector<float>{1, -2, 0.5f}, {1, 1}, TexelType::kF32);
  MaterialView m = emitter(vec3(0.25f));
  m.alpha_mode = AlphaMode::kBlend;
  m.constant.alpha = 0.5f;
  const u32 lamp = scene.add_instance(scene.add(rectangle(1, 1)), scene.add(m));
  LightView& light = scene.add_light(lamp, 0, vec3(4));
  light.texture = no_texture();
  light.texture.texture = texture;
  const SceneView& view = scene.finish();
  LightSample s;
  REQUIRE(sample_light(view, from(view, {0, 0, 1}), {0.4f, 0.6f}, s));
  const vec3 radiance = light_radiance(view, s);
  CHECK(radiance.x == Approx(0.5f * 4.25f));
  CHECK(radiance.y == Approx(0.5f * 0.25f));
  CHECK(radiance.z == Approx(0.5f * 2.25f));
}

TEST_CASE("sun: irradiance is pi L sin^2 of the angular radius, whoever finds it") {
  for (const float angle : {0.00465f, 0.3f}) {
    for (const float roughness : {1.0f, 0.1f}) {
      TestScene scene;
      MaterialView m = lambert(vec3(0.5f));
      if (roughness < 1) {
        m.constant.base_color = vec3(1);
        m.constant.metallic = 1;
        m.constant.roughness = roughness;
      }
      scene.add_instance(scene.add(rectangle(10, 10)), scene.add(m));
      SunView sun{};
      sun.direction = normalize(vec3(1, 0, 2));
      sun.one_minus_cos = float(2 * std::pow(std::sin(0.5 * double(angle)), 2));
      sun.radiance = vec3(3);
      sun.visibility = kAllRays;
      scene.suns.push_back(sun);
      const SceneView& view = scene.finish();
      const vec3 eye = 4.0f * vec3(-sun.direction.x, 0, sun.direction.z);
      const CameraView camera = look_at(eye, {0, 0, 0}, {4, 4}, 0.001f);
      const float got = mean_beauty(view, camera, standard_settings(2), 4096).y;
      INFO("angle " << angle << " roughness " << roughness);
      if (roughness == 1) {
        const double sine = std::sin(double(angle));
        const double irradiance = 3 * M_PI * sine * sine * double(sun.direction.z);
        CHECK(got == Approx(0.5 / M_PI * irradiance).epsilon(0.003));
      } else if (angle > 0.2f) {
        CHECK(got == Approx(3).epsilon(0.05));  // the lobe lies within the sun
      }
      Path path{};
      path.ray.direction = sun.direction;
      path.mask = kCameraRay;
      path.edges = 1;
      CHECK(met_sun(view.suns[0], path).y == 3);
      path.ray.direction = normalize(sun.direction + vec3(0, 1.01f * std::tan(angle), 0));
      CHECK(met_sun(view.suns[0], path).y == 0);
    }
  }
}
