// Cameras: rays and projections invert each other.
#include "kernels/camera/camera.h"

#include "tests/unit/catch.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

TEST_CASE("camera: a point on a ray projects to where the ray starts") {
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    CameraView c = look_at({3, -4, 5}, {0.3f, 0.2f, 0.1f}, {64, 48}, 0.9f);
    c.lens.projection = projection;
    c.fx *= 1.3f;
    c.cx += 7;
    c.cy -= 3.5f;
    for (const vec2 raster : {vec2(0, 0), vec2(13.25f, 40.5f), vec2(64, 48)}) {
      const Ray ray = camera_ray(c, raster, {0, false});
      CHECK(length(ray.direction) == Approx(1));
      const vec3 p = ray.origin + ray.direction * 2.5f;
      const Projected back = project(c, p);
      CHECK(back.seen);
      CHECK(length(back.raster - raster) < 1e-3f);
      CHECK(!project(c, ray.origin - ray.direction).seen);
      const Ray to = camera_ray_to(c, p, {0, false});
      CHECK(length(to.origin - ray.origin) < 1e-4f);
      CHECK(length(to.direction - ray.direction) < 1e-5f);
      CHECK(to.t_max == Approx(2.5f));
    }
  }
}

TEST_CASE("camera: x right, y down, K at integer pixel centres plus one half") {
  CameraView c = look_at({0, 0, 5}, {0, 0, 0}, {64, 48}, 0.9f);
  // Looks down: image up is +y, right is +x.
  const Projected p = project(c, {0.5f, 0.25f, 0});
  CHECK(p.raster.x == Approx(32 + c.fx * 0.1f));
  CHECK(p.raster.y == Approx(24 - c.fy * 0.05f));
  CHECK(inside_image(c, p.raster));
  CHECK(!inside_image(c, vec2(64, 3)));
  CHECK(inside_image(c, vec2(0, 0)));
}

TEST_CASE("camera: directions at infinity") {
  const CameraView c = look_at({1, 2, 3}, {0, 0, 0}, {64, 48}, 0.9f);
  const Ray ray = camera_ray(c, {10, 20}, {0, false});
  const Projected p = project_direction(c, ray.direction, vec2(-1));
  CHECK(p.seen);
  CHECK(length(p.raster - vec2(10, 20)) < 1e-3f);
  CHECK(!project_direction(c, -ray.direction, vec2(-1)).seen);
}

namespace {
/// A camera above the origin that looks down, its lens open.
CameraView wide_open(u32 blades) {
  CameraView c = look_at({0, 0, 5}, {0, 0, 0}, {64, 48}, 0.9f);
  c.aperture = {.radius = 0.1f, .focus = 4, .blades = blades, .turn = 0.1f};
  return c;
}
}  // namespace

TEST_CASE(
    "camera: rays of a thin lens meet on the plane of focus and start all over the aperture") {
  Random random(4);
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    CameraView c = wide_open(0);
    c.lens.projection = projection;
    if (projection == Projection::kOrthographic) c.fx = c.fy = 10;
    const vec2 raster(50.25f, 7.5f);
    const Ray sharp = camera_ray(c, raster, {0, false});
    const vec3 focus = sharp.origin - sharp.direction * (4 / sharp.direction.z);
    CHECK(focus.z == Approx(1));
    float widest = 0;
    for (int i = 0; i < 1000; ++i) {
      const Ray ray = thin_lens_ray(c, raster, random.next2(), {0, false});
      const vec3 met = ray.origin + ray.direction * dot(focus - ray.origin, ray.direction);
      CHECK(length(met - focus) < 1e-5f);
      widest = std::max(widest, length(ray.origin - sharp.origin));
    }
    CHECK(widest <= 0.1f * 1.0001f);
    CHECK(widest > 0.098f);
  }
}

TEST_CASE("camera: samples of a polygon fill its blades evenly") {
  Random random(5);
  const ApertureView aperture{.radius = 1, .focus = 1, .blades = 5, .turn = 0.1f};
  constexpr int kSamples = 50000;
  vec2 mean(0);
  float square = 0;
  for (int i = 0; i < kSamples; ++i) {
    const vec2 p = sample_aperture(aperture, random.next2());
    for (int edge = 0; edge < 5; ++edge) {
      const float middle = 2 * kPi * (0.1f + (float(edge) + 0.5f) / 5);
      CHECK(p.x * std::cos(middle) + p.y * std::sin(middle) <= std::cos(kPi / 5) + 1e-5f);
    }
    mean += p / float(kSamples);
    square += dot(p, p) / kSamples;
  }
  // A regular polygon of n corners at 1 has mean |p|^2 = (2 + cos(2 pi / n)) / 6; 5 sigma.
  CHECK(square == Approx((2 + std::cos(2 * kPi / 5)) / 6).margin(5 * 0.25 / std::sqrt(kSamples)));
  CHECK(length(mean) < 5 * 0.6 / std::sqrt(float(kSamples)));
  const vec2 corner = sample_aperture(aperture, vec2(0, 0));
  CHECK(length(corner) < 1.0001f);
}

TEST_CASE("camera: clipping planes are metres along the optical axis") {
  CameraView c = look_at({0, 0, 5}, {0, 0, 0}, {64, 48}, 0.9f);
  c.near = 2;
  c.far = 4.5f;
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    c.lens.projection = projection;
    for (const vec2 raster : {vec2(1, 2), vec2(40, 24)}) {
      const Ray ray = camera_ray(c, raster, {0, false});
      CHECK(ray.origin.z == Approx(3));
      CHECK((ray.origin + ray.direction * ray.t_max).z == Approx(0.5f));
      CHECK(near_of(c, ray.direction) == Approx(2 / -ray.direction.z));
    }
  }
  CHECK(within_clip(c, vec3(1, 1, 2.9f)));
  CHECK_FALSE(within_clip(c, vec3(1, 1, 3.1f)));
  CHECK_FALSE(within_clip(c, vec3(1, 1, 0.4f)));
  CHECK(clipped(c, camera_ray_to(c, vec3(0, 0, 3.5f), {0, true})).t_max < 0);
}
