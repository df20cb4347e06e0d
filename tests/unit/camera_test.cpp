// Cameras: rays and projections invert each other.
#include "kernels/camera/camera.h"

#include "kernels/camera/rolling.h"

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

namespace {
/// Rays that start apart and look aside, each in its own direction.
std::vector<TableRay> fan(uvec2 size) {
  std::vector<TableRay> rays;
  for (u32 y = 0; y < size.y; ++y)
    for (u32 x = 0; x < size.x; ++x)
      rays.push_back({vec3(0.01f * float(x), 0, 0.02f * float(y)),
                      vec3(0.1f * float(x) - 0.3f, 0.2f - 0.1f * float(y), 1) * 3.0f});
  return rays;
}
CameraView scanner(const std::vector<TableRay>& rays, uvec2 size) {
  CameraView c = look_at({1, 2, 3}, {1, 2, 4}, size, 0.9f);
  c.lens.projection = Projection::kRayTable;
  c.table.rays = rays.data();
  return c;
}
}  // namespace

TEST_CASE("camera: a table's pixel looks along its ray") {
  const uvec2 size(6, 4);
  std::vector<TableRay> rays = fan(size);
  rays[9].direction = vec3(0);
  CameraView c = scanner(rays, size);
  c.near = 0.5f;
  for (u32 y = 0; y < size.y; ++y)
    for (u32 x = 0; x < size.x; ++x) {
      const TableRay& own = rays[y * size.x + x];
      const Ray ray = camera_ray(c, centre_of(x, y) + vec2(0.3f, -0.4f), {0, false});
      if (y * size.x + x == 9) {
        CHECK(!(ray.t_max > 0));
        continue;
      }
      const vec3 along = turn_to_camera(c, ray.direction);
      CHECK(length(along - normalize(own.direction)) < 1e-6f);
      CHECK(length(point_in_camera(c, ray.origin) - own.origin - 0.5f * along) < 2e-6f);
      CHECK(!project(c, ray.origin + ray.direction).seen);
    }
  CHECK(!(camera_ray(c, vec2(-0.1f, 1), {0, false}).t_max > 0));
  CHECK(!(camera_ray(c, vec2(NAN, 1), {0, false}).t_max > 0));
}

TEST_CASE("camera: between a table's rays, and beyond the outermost ones") {
  const uvec2 size(6, 4);
  const std::vector<TableRay> rays = fan(size);
  CameraView c = scanner(rays, size);
  c.table.interpolated = true;
  for (const vec2 raster : {vec2(0.5f, 0.5f), vec2(3, 2), vec2(2.75f, 1.3f), vec2(-0.4f, 4.2f)}) {
    const vec2 at = raster - 0.5f;
    const TableRay ray = table_ray(c.table, size, raster);
    CHECK(length(ray.origin - vec3(0.01f * at.x, 0, 0.02f * at.y)) < 1e-6f);
    const vec3 want = normalize(vec3(0.1f * at.x - 0.3f, 0.2f - 0.1f * at.y, 1));
    CHECK(length(normalize(ray.direction) - want) < 0.5f * sqr(0.1f));  // chords of such a step
  }
  CHECK(!sees(table_ray(c.table, size, vec2(-3, 2))));
}

TEST_CASE("camera: a table's pixel has its time") {
  const uvec2 size(3, 2);
  const std::vector<TableRay> rays(6, {vec3(0), vec3(0, 0, 1)});
  const std::vector<float> times{0, 1, 2, 3, 4, 5};
  CameraView c = scanner(rays, size);
  c.table.times = times.data();
  c.shutter = {.open = 0.1f, .length = 0.2f, .row = 0, .seconds = 0.125f};
  CHECK(pixel_time(c, 2, 1) == Approx(0.1f + 5 * 0.125f));
  c.table.times = nullptr;
  c.shutter.row = 0.25f;
  CHECK(pixel_time(c, 2, 1) == Approx(0.35f));
  CHECK(pixel_time(c, 2, 1) == row_time(c, 1.5f));
}
