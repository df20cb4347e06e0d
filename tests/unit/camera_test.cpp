// Cameras: rays and projections invert each other.
#include "kernels/camera.h"

#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

TEST_CASE("camera: a point on a ray projects to where the ray starts") {
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    CameraView c = look_at({3, -4, 5}, {0.3f, 0.2f, 0.1f}, {64, 48}, 0.9f);
    c.projection = projection;
    c.fx *= 1.3f;
    c.cx += 7;
    c.cy -= 3.5f;
    for (const vec2 raster : {vec2(0, 0), vec2(13.25f, 40.5f), vec2(64, 48)}) {
      const Ray ray = camera_ray(c, raster, {0, false});
      CHECK(length(ray.direction) == Approx(1));
      const vec3 p = ray.origin + ray.direction * 2.5f;
      const Projected back = project(c, p);
      CHECK(back.in_front);
      CHECK(length(back.raster - raster) < 1e-3f);
      CHECK(!project(c, ray.origin - ray.direction).in_front);
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
  CHECK(p.in_front);
  CHECK(length(p.raster - vec2(10, 20)) < 1e-3f);
  CHECK(!project_direction(c, -ray.direction, vec2(-1)).in_front);
}
