// What labels say of a hit, against the same in double precision, where triangles are large and
// worlds far.
#include <algorithm>

#include "kernels/label/probe.h"
#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

using glm::dmat3;
using glm::dvec2;
using glm::dvec3;

constexpr double kEpsilon = 0x1p-24;
constexpr uvec2 kSize(64, 48);
const Settings kSettings = standard_settings(1);

struct Exact {
  double t;
  dvec2 place;
  dvec3 from_eye;
  double cosine;  // between the ray and the normal
};

/// Where a ray meets the plane of triangle `primitive` of instance 0.
Exact exact_hit(const SceneView& scene, const CameraView& camera, const Sight& sight,
                u32 primitive) {
  const glm::dmat4x3 m(scene.instances[0].world_from_object);
  const dmat3 linear{m[0], m[1], m[2]};
  const uvec3 triangle = scene.meshes[0].triangles[primitive];
  const vec3* positions = scene.meshes[0].positions;
  const dvec3 a = linear * dvec3(positions[triangle.x]) + m[3];
  const dvec3 b = linear * dvec3(positions[triangle.y]) + m[3];
  const dvec3 c = linear * dvec3(positions[triangle.z]) + m[3];
  const dvec3 o(sight.ray.origin), d = sight.direction, n = cross(b - a, c - a);
  const double t = dot(n, a - o) / dot(n, d);
  const dvec3 p = o + d * t;
  const double area = dot(n, n);
  return {t,
          {dot(cross(p - a, c - a), n) / area, dot(cross(b - a, p - a), n) / area},
          o - dvec3(camera.world_from_camera[3]) + d * t,
          std::fabs(dot(n, d)) / std::sqrt(area)};
}

/// The largest errors of a picture of instance 0. Distances are in units of their rounding.
struct Worst {
  double distance = 0, in_camera = 0, place = 0, metres = 0;
  double raw = 0;  // of the tracer's own places, metres
  u32 pixels = 0;
};

Worst worst_of(const SceneView& scene, const CameraView& camera) {
  const TestFilm film(kSize, planes_of(Fold::kCentre) & ~planes_from<ProbeRest>());
  const TestTracer tracer(scene);
  Worst worst;
  for (u32 y = 0; y < kSize.y; ++y)
    for (u32 x = 0; x < kSize.x; ++x) {
      probe_pixel<TestTracer>({{&scene, &camera}, {}, {}, nullptr, &kSettings}, tracer, nullptr,
                              nullptr, film.view, x, y);
      const u64 i = u64(y) * kSize.x + x;
      const Sight sight = centre_sight(camera, centre_of(x, y));
      const Hit hit = tracer.closest(sight.ray, kCameraRay);
      if (hit.instance == kNone) continue;
      const Exact exact = exact_hit(scene, camera, sight, hit.primitive);
      const double ulp = kEpsilon * exact.t;
      const glm::dmat4x3 from_camera(camera.world_from_camera);
      const dvec3 away = dmat3{from_camera[0], from_camera[1], from_camera[2]} *
                         dvec3(cv_from_gl(at3(film, Plane::POSITION_CAMERA, i)));
      const dvec2 place(film.centre(Plane::BARYCENTRIC, 2 * i),
                        film.centre(Plane::BARYCENTRIC, 2 * i + 1));
      const auto grow = [](double& most, double error) { most = std::max(most, error); };
      grow(worst.distance, std::fabs(film.centre(Plane::DISTANCE, i) - exact.t) / ulp);
      grow(worst.in_camera, length(away - exact.from_eye) / ulp);
      grow(worst.place, length(place - exact.place));
      const dvec3 p = exact.from_eye + dvec3(camera.world_from_camera[3]);
      grow(worst.metres, length(dvec3(at3(film, Plane::POSITION, i)) - p));
      const Surface raw = locate(scene, 0, hit.primitive, vec2(hit.u, hit.v), 0);
      grow(worst.raw, length(dvec3(raw.p) - p));
      ++worst.pixels;
    }
  return worst;
}

TestScene scene_of(TestMesh mesh, const mat4x3& world_from_object) {
  TestScene scene;
  scene.add_instance(scene.add(std::move(mesh)), scene.add(lambert(vec3(0.5f))), world_from_object);
  scene.instances[0].label = 1;
  return scene;
}

/// A frame about a slanted normal: no row of it is an axis of the world.
mat3 tilt() {
  const Frame f = make_frame(normalize(vec3(0.3f, -0.2f, 1)));
  return mat3(f.s, f.t, f.n);
}

}  // namespace

TEST_CASE("refined: a place on a floor of two triangles is exact however large the floor is") {
  for (const float side : {4.0f, 100.0f, 1000.0f}) {
    TestScene scene = scene_of(rectangle(side, side), pose(tilt(), vec3(0.1f, 0.2f, 0.3f)));
    const CameraView camera = look_at(tilt() * vec3(0, -2, 1), tilt() * vec3(0, 0, 0.3f), kSize, 1);
    const Worst worst = worst_of(scene.finish(), camera);
    INFO(side << ": distance " << worst.distance << ", camera " << worst.in_camera << ", place "
              << worst.place << ", metres " << worst.metres << ", raw " << worst.raw);
    CHECK(worst.pixels > 1000);
    CHECK(worst.distance <= 1);
    CHECK(worst.in_camera < 8);
    CHECK(worst.place < 2 * kEpsilon);
    CHECK(worst.metres < worst.raw);
  }
}

TEST_CASE("refined: far from the origin of the world a place before the camera is as exact") {
  for (const float away : {0.0f, 100.0f, 1000.0f, 4000.0f}) {
    const vec3 place(away, -away / 2, away / 4);
    TestScene scene = scene_of(rectangle(1, 1), pose(tilt(), place));
    const CameraView camera = look_at(place + tilt() * vec3(0.5f, -2, 1), place, kSize, 0.6f);
    const Worst worst = worst_of(scene.finish(), camera);
    INFO(away << ": distance " << worst.distance << ", camera " << worst.in_camera << ", place "
              << worst.place << ", raw " << worst.raw);
    CHECK(worst.pixels > 500);
    CHECK(worst.distance <= 1);
    CHECK(worst.in_camera < 8);
    CHECK(worst.place < 2 * kEpsilon);
  }
}

TEST_CASE("refined: behind glass the distance counts from the camera") {
  TestScene scene = scene_of(rectangle(4, 4), pose(tilt(), vec3(0)));
  MaterialView glass = standard_material();
  glass.constant.transmission = 1;
  glass.constant.roughness = 0;
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(glass),
                     pose(tilt(), tilt() * vec3(0, 0, 0.5f)));
  const SceneView& view = scene.finish();
  const CameraView camera = look_at(tilt() * vec3(0, -2, 2), vec3(0), kSize, 0.8f);
  Settings settings = kSettings;
  settings.through_transmission = true;
  const TestFilm film(kSize, planes_of(Fold::kCentre) & ~planes_from<ProbeRest>());
  const TestTracer tracer(view);
  u32 seen = 0;
  for (u32 y = 0; y < kSize.y; ++y)
    for (u32 x = 0; x < kSize.x; ++x) {
      probe_pixel<TestTracer>({{&view, &camera}, {}, {}, nullptr, &settings}, tracer, nullptr,
                              nullptr, film.view, x, y);
      const u64 i = u64(y) * kSize.x + x;
      if (film.centre<u32>(Plane::INSTANCE, i) != 1) continue;
      ++seen;
      const Exact exact = exact_hit(view, camera, centre_sight(camera, centre_of(x, y)),
                                    film.centre<u32>(Plane::PRIMITIVE, i));
      CHECK(std::fabs(film.centre(Plane::DISTANCE, i) - exact.t) <= kEpsilon * exact.t);
    }
  CHECK(seen > 1000);
}
