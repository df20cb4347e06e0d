// Round segments against signed distances in double precision: where rays meet them, their places,
// normals and bounds; strands without leaks, and white ones in a white furnace.
#include "kernels/geometry/curve.h"

#include <algorithm>

#include "kernels/bvh/bvh_box.h"
#include "tests/unit/catch.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

using glm::dvec3;

float uniform(Random& random, float from, float to) { return from + (to - from) * random.next(); }
vec3 in_box(Random& random, float half) {
  const float x = uniform(random, -half, half), y = uniform(random, -half, half);
  return {x, y, uniform(random, -half, half)};
}
vec3 direction(Random& random) { return sample_sphere(random.next2()); }

MeshView view_of(const TestMesh& m) {
  MeshView v{};
  v.triangles = m.triangles.data();
  v.positions = v.rest_positions = m.positions.data();
  v.strand_points = m.strand_points.data();
  v.triangle_count = u32(m.triangles.size());
  v.vertex_count = u32(m.positions.size());
  v.shape = m.shape;
  return v;
}

/// Signed distance to the convex hull of two spheres.
///
/// Source: Quilez 2018, "Distance functions", round cone.
double distance_to(const MeshView& mesh, u32 segment, dvec3 p) {
  const uvec3 points = mesh.triangles[segment];
  const dvec3 a(mesh.positions[points.x]), b(mesh.positions[points.y]), ba = b - a, pa = p - a;
  const double r1 = double(mesh.strand_points[points.x].w),
               r2 = double(mesh.strand_points[points.y].w), l2 = dot(ba, ba), rr = r1 - r2;
  if (l2 <= rr * rr) return std::min(length(pa) - r1, length(p - b) - r2);
  const double a2 = l2 - rr * rr, il2 = 1 / l2, y = dot(pa, ba), z = y - l2;
  const dvec3 off = pa * l2 - ba * y;
  const double x2 = dot(off, off), y2 = y * y * l2, z2 = z * z * l2;
  const double k = std::copysign(1.0, rr) * rr * rr * x2;
  if (std::copysign(1.0, z) * a2 * z2 > k) return std::sqrt(x2 + z2) * il2 - r2;
  if (std::copysign(1.0, y) * a2 * y2 < k) return std::sqrt(x2 + y2) * il2 - r1;
  return (std::sqrt(x2 * a2 * il2) + y * rr) * il2 - r1;
}

/// Distances at which a ray enters and leaves a segment, by bisection: along a line the signed
/// distance to what is convex is convex. False: it passes by more than `margin`.
bool bisect(const MeshView& mesh, dvec3 origin, dvec3 d, double far, double& enter, double& leave) {
  const auto at = [&](double t) { return distance_to(mesh, 0, origin + d * t); };
  double low = 0, high = far;
  for (int i = 0; i < 120; ++i) {
    const double third = (high - low) / 3;
    if (at(low + third) < at(high - third))
      high -= third;
    else
      low += third;
  }
  const double nearest = (low + high) / 2;
  if (at(nearest) >= 0) return false;
  const auto root = [&](double outside, double inside) {
    for (int i = 0; i < 80; ++i) {
      const double middle = (outside + inside) / 2;
      (at(middle) > 0 ? outside : inside) = middle;
    }
    return outside;
  };
  enter = root(0, nearest);
  leave = root(far, nearest);
  return true;
}

/// A segment of two points near the origin, of any slope, some in each other, some of no length.
TestMesh random_segment(Random& random) {
  const float kind = random.next(), thin = std::exp2(-12 * random.next());
  vec3 b = in_box(random, 1);
  const vec3 a = in_box(random, 1);
  float ra = uniform(random, 0.01f, 1) * thin, rb = uniform(random, 0.01f, 1) * thin;
  if (kind < 0.1f)
    b = a;
  else if (kind < 0.2f)
    b = a + (b - a) * 0.1f * ra;
  else if (kind < 0.4f)
    rb = ra;
  return strand({vec4(a, ra), vec4(b, rb)});
}

/// A ray from `away` radii of the segment to about the segment; some along it, some past its edge.
ShapeRay random_ray(Random& random, const TestMesh& m, float away) {
  const vec3 a = m.positions[0], b = m.positions[1];
  const float u = random.next(),
              radius = m.strand_points[0].w + u * (m.strand_points[1].w - m.strand_points[0].w);
  const vec3 target =
      a + (b - a) * u + direction(random) * (1.2f * radius * std::sqrt(random.next()));
  vec3 d = direction(random);
  if (random.next() < 0.1f && length(b - a) > 0) d = normalize(normalize(b - a) + d * 1e-3f);
  return {target - d * away, d, INFINITY};
}

}  // namespace

TEST_CASE("curves: a ray meets a segment where its signed distance is 0") {
  Random random(7);
  double worst_enter = 0, worst_leave = 0;
  int hits = 0, differ = 0;
  for (int i = 0; i < 20000; ++i) {
    const TestMesh m = random_segment(random);
    const MeshView mesh = view_of(m);
    const ShapeRay ray = random_ray(random, m, 8);
    const dvec3 o(ray.origin), d = normalize(dvec3(ray.direction));
    double enter = 0, leave = 0;
    const bool is_met = bisect(mesh, o, d, 20, enter, leave);
    SegmentHitOf<double> hit, exit;
    const bool met = meet_segment<double>({mesh, 0, 0}, {o, d, INFINITY}, hit);
    if (met != is_met) {
      // At a silhouette bisection sees as far as its steps.
      differ += !(leave - enter < 1e-6);
      continue;
    }
    if (!met) continue;
    ++hits;
    // Rounding moves a surface that the ray grazes along the ray by its square root.
    const double graze = 1e-13 / std::max(leave - enter, 1e-7);
    worst_enter = std::max(worst_enter, std::fabs(hit.t - enter) / (1e-12 + graze));
    const double middle = (enter + leave) / 2;
    REQUIRE(meet_segment<double>({mesh, 0, 0}, {o + d * middle, d, INFINITY}, exit));
    worst_leave = std::max(worst_leave, std::fabs(middle + exit.t - leave) / (1e-12 + graze));
  }
  CHECK(hits > 8000);
  CHECK(differ == 0);
  CHECK(worst_enter < 10);
  CHECK(worst_leave < 10);
}

TEST_CASE("curves: single precision finds what double precision does, at any scale") {
  Random random(8);
  const int count = 2'000'000;
  int hits = 0, differ = 0;
  double worst = 0, worst_normal = 0, worst_point = 0;
  for (int i = 0; i < count; ++i) {
    TestMesh m = random_segment(random);
    ShapeRay ray = random_ray(random, m, 4);
    const float scale = std::exp2(std::floor(uniform(random, -30, 30)));
    for (vec3& p : m.positions) p *= scale;
    for (vec4& p : m.strand_points) p.w *= scale;
    ray.origin *= scale;
    ray.direction *= std::exp2(std::floor(uniform(random, -30, 30)));
    const MeshView mesh = view_of(m);
    const PrimitiveAt at{mesh, 0, 0};
    SegmentHitOf<double> exact{};
    ShapeHit hit;
    const dvec3 o(ray.origin), d(ray.direction);
    const bool is_met = meet_segment<double>(at, {o, d, INFINITY}, exact);
    const bool met = meet_primitive(at, ray, hit);
    const double radius = double(std::max(m.strand_points[0].w, m.strand_points[1].w));
    const double rounding = 0x1p-21 * 8 * double(scale);  // of a ray that begins 8 units away
    if (met != is_met) {
      // A silhouette: the ray's distance from the surface is within rounding.
      const dvec3 p = o + d * (met ? double(hit.t) : exact.t);
      differ += std::fabs(distance_to(mesh, 0, p)) > rounding + 1e-2 * radius;
      continue;
    }
    if (!met) continue;
    ++hits;
    const PrimitiveSurface s = Curves::surface(at, hit.place);
    const double off = std::fabs(distance_to(mesh, 0, dvec3(s.p)));
    worst_point = std::max(worst_point, off / (rounding + 1e-6 * radius));
    worst = std::max(worst, std::fabs(distance_to(mesh, 0, o + d * double(hit.t))) / rounding);
    dvec3 gradient;
    const double step = 1e-5 * radius;
    for (int k = 0; k < 3; ++k) {
      dvec3 aside(0);
      aside[k] = step;
      gradient[k] =
          (distance_to(mesh, 0, dvec3(s.p) + aside) - distance_to(mesh, 0, dvec3(s.p) - aside)) /
          (2 * step);
    }
    if (i % 16 == 0)
      worst_normal = std::max(worst_normal, length(normalize(gradient) - dvec3(s.normal)) * radius /
                                                (rounding + 1e-5 * radius));
    if (!(std::fabs(length(s.normal) - 1) < 1e-5f)) FAIL("a normal's length");
  }
  CHECK(hits > count / 3);
  CHECK(differ == 0);
  CHECK(worst < 2);
  CHECK(worst_point < 2);
  CHECK(worst_normal < 20);
}

TEST_CASE("curves: boxes hold the surface, over all times") {
  Random random(9);
  for (int i = 0; i < 20000; ++i) {
    TestMesh m = random_segment(random);
    const vec3 move = in_box(random, 1);
    m.positions.push_back(m.positions[0] + move);
    m.positions.push_back(m.positions[1] + in_box(random, 1));
    MeshView mesh = view_of(m);
    mesh.vertex_count = 2;
    mesh.segments = 1;
    const BvhBox box = primitive_box(mesh, 0);
    const PrimitiveAt at{mesh, 0, random.next()};
    const vec3 p = Curves::surface(at, vec2(uniform(random, -1, 2), random.next())).p;
    const bool within =
        glm::all(glm::lessThanEqual(box.lower, p)) && glm::all(glm::lessThanEqual(p, box.upper));
    if (!within) FAIL("a point outside of its box");
  }
}

TEST_CASE("curves: places follow a strand that turns") {
  TestMesh m = strand({{0, 0, 0, 0.1f}, {0, 0, 1, 0.2f}});
  const MeshView rest = view_of(m);
  const mat3 turn = rotation({0.3f, -0.8f, 0.1f}, 1.1f);
  std::vector<vec3> turned{turn * m.positions[0], turn * m.positions[1]};
  MeshView mesh = rest;
  mesh.positions = turned.data();
  Random random(3);
  // The shortest turn of the axis: what it does to the strand's surface it does to each place.
  const vec3 axis = normalize(turned[1]), across = normalize(cross(vec3(0, 0, 1), axis));
  const mat3 shortest = rotation(across, std::acos(axis.z));
  for (int i = 0; i < 1000; ++i) {
    const vec2 place(uniform(random, -1, 2), random.next());
    const vec3 before = Curves::surface({rest, 0, 0}, place).p;
    CHECK(length(Curves::surface({mesh, 0, 0}, place).p - shortest * before) < 1e-6f);
  }
}

TEST_CASE("curves: no ray goes through a strand, and none stops within it") {
  Random random(11);
  int inside = 0;
  for (int i = 0; i < 300; ++i) {
    std::vector<vec4> points{vec4(0, 0, 0, 0.1f)};
    for (int k = 0; k < 6; ++k)
      points.emplace_back(vec3(points.back()) + direction(random) * uniform(random, 0.2f, 0.5f),
                          uniform(random, 0.06f, 0.12f));
    TestScene scene;
    scene.add_instance(scene.add(strand(points)), scene.add(lambert(vec3(1))));
    const SceneView& view = scene.finish();
    const TestTracer tracer(view);
    const MeshView& mesh = view.meshes[0];
    for (int k = 0; k < 300; ++k) {
      const u32 segment = u32(random.next() * 6);
      const vec3 a = mesh.positions[segment], b = mesh.positions[segment + 1];
      const vec3 on_axis = a + (b - a) * (random.next() < 0.5f ? 0.0f : random.next());
      const vec3 d = direction(random);
      const Hit in = tracer.closest({on_axis - d * 5.0f, d, 5, 0, {}}, kAllRays);
      REQUIRE(in.instance == 0);
      const Hit out = tracer.closest({on_axis, d, INFINITY, 0, {}}, kAllRays);
      REQUIRE(out.instance == 0);
      // What a segment's neighbours hold is no surface; what others hold may be.
      const dvec3 p = dvec3(on_axis) + dvec3(d) * double(out.t);
      for (const u32 other : {out.primitive - 1, out.primitive + 1})
        if (other < mesh.triangle_count) inside += distance_to(mesh, other, p) < -2e-4;
    }
  }
  CHECK(inside == 0);
}

TEST_CASE("curves: a white strand in a white furnace is white") {
  TestScene scene;
  std::vector<vec4> points;
  for (int i = 0; i < 12; ++i) {
    const float t = 0.5f * float(i);
    points.emplace_back(std::cos(t), std::sin(t), 0.12f * t, 0.05f + 0.02f * float(i % 3));
  }
  scene.add_instance(scene.add(strand(points)), scene.add(lambert(vec3(1))));
  scene.set_dome(vec3(1));
  const SceneView& view = scene.finish();
  const CameraView camera = look_at({3, 0, 2}, {0, 0, 0.3f}, {24, 24}, 0.8f);
  const vec3 mean = mean_beauty(view, camera, standard_settings(200), 64);
  CHECK(std::fabs(mean.x - 1) < 1e-3f);
  CHECK(std::fabs(mean.y - 1) < 1e-3f);
}
