// Lens models: places in the image and rays invert each other wherever the model is invertible.
#include "kernels/camera/distortion.h"

#include "kernels/camera/camera.h"

#include "tests/unit/catch.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

using Model = LensModel<double>;

Model perspective(std::initializer_list<double> k) {
  Model lens{.projection = Projection::kPerspective, .distorted = true};
  std::copy(k.begin(), k.end(), lens.k);
  lens.limit = lens_limit(lens);
  return lens;
}

Model fisheye(std::initializer_list<double> k) {
  Model lens{.projection = Projection::kFisheye};
  std::copy(k.begin(), k.end(), lens.k);
  lens.limit = lens_limit(lens);
  return lens;
}

LensModel<float> single(const Model& lens) {
  LensModel<float> out{.projection = lens.projection, .distorted = lens.distorted};
  for (int i = 0; i < 8; ++i) out.k[i] = float(lens.k[i]);
  out.limit = float(lens.limit);
  return out;
}

/// Lenses as they are calibrated, and stronger ones.
Model random_lens(Random& random, bool is_fisheye) {
  const auto within = [&](double size) { return (2 * double(random.next()) - 1) * size; };
  if (is_fisheye) return fisheye({within(0.1), within(0.05), within(0.02), within(0.01)});
  return perspective({within(0.4), within(0.3), within(0.01), within(0.01), within(0.1),
                      within(0.3), within(0.1), within(0.05)});
}

/// A camera 1000 pixels wide, its focal length 700, its lens `lens`.
CameraView camera_with(const Model& lens) {
  CameraView c = look_at({3, -4, 5}, {0.3f, 0.2f, 0.1f}, {1000, 800}, 1.0f);
  c.fx = 700;
  c.fy = 690;
  c.cx += 11;
  c.lens = single(lens);
  return c;
}

}  // namespace

TEST_CASE("distortion: raster to ray to raster within 0.01 pixels, for random coefficients") {
  Random random(1);
  u32 seen = 0, blind = 0;
  float worst = 0;
  for (int lens = 0; lens < 200; ++lens) {
    const CameraView camera = camera_with(random_lens(random, lens % 2 == 1));
    for (float y = -1600; y < 2400; y += 149)
      for (float x = -2000; x < 3000;
           x += 151)  // the canvas: tracers refuse rays that are not unit
        REQUIRE(length(pinhole_ray(camera, vec2(x, y), {0, true}).direction) == Approx(1));
    for (float y = 0.5f; y < 800; y += 37)
      for (float x = 0.5f; x < 1000; x += 41) {
        const Ray ray = pinhole_ray(camera, vec2(x, y), {0, true});
        if (!(ray.t_max > 0)) {
          ++blind;
          continue;
        }
        ++seen;
        const Projected back = project_direction(camera, ray.direction, vec2(-1));
        REQUIRE(back.seen);
        worst = std::max(worst, length(back.raster - vec2(x, y)));
      }
  }
  INFO("seen " << seen << ", blind " << blind << ", worst " << worst);
  CHECK(worst < 0.01f);
  CHECK(seen > 20 * blind);
}

TEST_CASE("distortion: every point within the limit comes back, in f64 to 1e-9") {
  Random random(2);
  for (int trial = 0; trial < 400; ++trial) {
    const bool is_fisheye = trial % 2 == 1;
    const Model lens = random_lens(random, is_fisheye);
    const double angle = is_fisheye ? lens.limit : std::atan(lens.limit);
    for (int i = 0; i < 50; ++i) {
      const double a = 0.98 * angle * double(random.next());
      const double turn = 2 * M_PI * double(random.next());
      const glm::dvec3 d(std::sin(a) * std::cos(turn), std::sin(a) * std::sin(turn), std::cos(a));
      glm::dvec2 m;
      REQUIRE(project(lens, d, m));
      glm::dvec3 back;
      INFO("lens " << trial << " angle " << a << " of " << angle);
      REQUIRE(unproject(lens, m, back));
      CHECK(glm::length(glm::normalize(back) - d) < 1e-9 * (1 + glm::length(m)));
    }
  }
}

TEST_CASE("distortion: the limit is where the model stops being invertible") {
  // r (1 - r^2 / 3) is largest at r = 1.
  const Model barrel = perspective({-1.0 / 3});
  CHECK(barrel.limit == Approx(1).epsilon(1e-9));
  glm::dvec2 m;
  CHECK(project(barrel, glm::dvec3(0.999, 0, 1), m));
  CHECK_FALSE(project(barrel, glm::dvec3(0, 1.001, 1), m));
  CHECK_FALSE(project(barrel, glm::dvec3(0.1, 0, -1), m));
  glm::dvec3 d;
  CHECK(unproject(barrel, glm::dvec2(0.6666, 0), d));
  CHECK_FALSE(unproject(barrel, glm::dvec2(0.6667, 0), d));
  // a (1 - a^2 / 3), the same for angles.
  const Model eye = fisheye({-1.0 / 3});
  CHECK(eye.limit == Approx(1).epsilon(1e-9));
  CHECK_FALSE(unproject(eye, glm::dvec2(0, -0.6667), d));
  CHECK(fisheye({}).limit == Approx(M_PI));
  CHECK(fisheye({0.1}).limit == Approx(M_PI));
  // Pincushion grows for ever; 89.9 degrees are kept.
  CHECK(perspective({0.2}).limit > 500);
}

TEST_CASE(
    "distortion: derivatives are those of the map, their least determinant is the closed form") {
  Random random(3);
  for (int trial = 0; trial < 100; ++trial) {
    const Model lens = random_lens(random, false);
    const double r = 0.9 * double(random.next());
    double least = 1e9;
    for (int i = 0; i < 3600; ++i) {
      const double turn = 2 * M_PI * i / 3600;
      const glm::dvec2 p(r * std::cos(turn), r * std::sin(turn));
      const Distorted<double> at = distort(lens.k, p);
      least = std::min(least, at.xx * at.yy - at.xy * at.xy);
      if (i % 360) continue;
      const double h = 1e-6;
      const glm::dvec2 x = (distort(lens.k, p + glm::dvec2(h, 0)).m - at.m) / h;
      const glm::dvec2 y = (distort(lens.k, p + glm::dvec2(0, h)).m - at.m) / h;
      CHECK(glm::length(x - glm::dvec2(at.xx, at.xy)) < 1e-4);
      CHECK(glm::length(y - glm::dvec2(at.xy, at.yy)) < 1e-4);
    }
    if (least > 0) CHECK(least_determinant(lens.k, r) == Approx(least).epsilon(1e-5));
  }
}

TEST_CASE("distortion: fisheye and panorama against arithmetic") {
  const auto at = [](const Model& lens, glm::dvec3 d) {
    glm::dvec2 m(99);
    REQUIRE(project(lens, d, m));
    return m;
  };
  const Model eye = fisheye({});
  CHECK(glm::length(at(eye, {0, 0, 2}) - glm::dvec2(0, 0)) < 1e-12);
  CHECK(glm::length(at(eye, {3, 0, 0}) - glm::dvec2(M_PI / 2, 0)) < 1e-12);
  CHECK(glm::length(at(eye, {0, -1, -1}) - glm::dvec2(0, -0.75 * M_PI)) < 1e-12);
  const Model panorama{.projection = Projection::kEquirectangular};
  CHECK(glm::length(at(panorama, {1, 0, 1}) - glm::dvec2(M_PI / 4, 0)) < 1e-12);
  CHECK(glm::length(at(panorama, {0, 5, 0}) - glm::dvec2(0, M_PI / 2)) < 1e-12);
  CHECK(glm::length(at(panorama, {-1, 0, -1e-9}) - glm::dvec2(-M_PI / 2, 0)) < 1e-8);
  const CameraView camera = [&] {
    CameraView c = camera_with(panorama);
    c.fx = 1000 / (2 * kPi);
    c.fy = 800 / kPi;
    c.cx = 500;
    return c;
  }();
  float worst = 0;
  for (float y = 0.5f; y < 800; y += 13)
    for (float x = 0.5f; x < 1000; x += 17) {
      const Ray ray = camera_ray(camera, vec2(x, y), {0, true});
      REQUIRE(ray.t_max > 0);
      const vec2 miss = project_direction(camera, ray.direction, vec2(0)).raster - vec2(x, y);
      // Pixels of a row near a pole are close to each other.
      const float latitude = (y - camera.cy) / camera.fy;
      worst = std::max(worst, length(miss * vec2(std::cos(latitude), 1)));
    }
  CHECK(worst < 0.01f);
  CHECK_FALSE(camera_ray(camera, vec2(-1, 400), {0, true}).t_max > 0);
  CHECK_FALSE(camera_ray(camera, vec2(500, 801), {0, true}).t_max > 0);
}
