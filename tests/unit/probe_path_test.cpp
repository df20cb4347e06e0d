// Centre planes of later vertices, against a mirror whose picture is known in closed form.
#include "kernels/label/probe_path.h"

#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

constexpr uvec2 kSize(48, 32);

MaterialView mirror() {
  MaterialView m = standard_material();
  m.constant.metallic = 1;
  m.constant.roughness = 0;
  return m;
}

}  // namespace

TEST_CASE("probe: a later vertex is what the path meets after it has scattered") {
  TestScene scene;
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(mirror()));
  scene.add_instance(scene.add(rectangle(2, 8)), scene.add(lambert(vec3(0.5f))),
                     pose(rotation({1, 0, 0}, kPi), {0, 0, 3}));
  scene.instances[0].label = 7;
  scene.instances[1].label = 9;
  const SceneView& view = scene.finish();
  const CameraView camera = look_at({0, -2, 1.5f}, {0, 0, 0}, kSize, 0.9f);
  const TestTracer tracer(view);
  const auto probed = [&](u32 vertex, u64 seed) {
    Settings settings = standard_settings(1);
    settings.seed = seed;
    settings.vertex = vertex;
    TestFilm film(kSize, planes_of(Fold::kCentre));
    const ProbeContext context{{&view, &camera}, {},        {},
                               nullptr,          &settings, scene.rest_boxes.data()};
    for (u32 y = 0; y < kSize.y; ++y)
      for (u32 x = 0; x < kSize.x; ++x)
        probe_vertex(context, tracer, &tracer, (const TestTracer*)nullptr, film.view, x, y);
    return film;
  };
  const TestFilm first = probed(0, 1), mirrored = probed(1, 1), scattered = probed(2, 1),
                 again = probed(2, 1), other = probed(2, 2);
  int met = 0, left = 0, differ = 0;
  for (u32 y = 0; y < kSize.y; ++y) {
    for (u32 x = 0; x < kSize.x; ++x) {
      const u64 i = u64(y) * kSize.x + x;
      const Ray ray = centre_ray(camera, centre_of(x, y));
      const vec3 floor = ray.origin - ray.direction * (ray.origin.z / ray.direction.z);
      if (!(ray.direction.z < 0) || max2(std::fabs(floor.x), std::fabs(floor.y)) > 3.99f) continue;
      CHECK(first.centre<u32>(Plane::INSTANCE, i) == 7);
      const vec3 up(ray.direction.x, ray.direction.y, -ray.direction.z);
      const vec3 ceiling = floor + up * (3 / up.z);
      if (std::fabs(std::fabs(ceiling.x) - 2) < 0.01f || std::fabs(ceiling.y) > 7.9f) continue;
      if (std::fabs(ceiling.x) > 2) {
        CHECK(mirrored.centre<u32>(Plane::INSTANCE, i) == 0);
        CHECK(std::isinf(mirrored.centre(Plane::DISTANCE, i)));
        CHECK(std::isinf(scattered.centre(Plane::DISTANCE, i)));
        ++left;
        continue;
      }
      ++met;
      CHECK(mirrored.centre<u32>(Plane::INSTANCE, i) == 9);
      CHECK(mirrored.centre(Plane::DISTANCE, i) == Approx(3 / up.z).epsilon(1e-4));
      CHECK(length(at3(mirrored, Plane::POSITION, i) - ceiling) < 1e-3f);
      CHECK(length(at3(mirrored, Plane::NORMAL, i) - vec3(0, 0, -1)) < 1e-5f);
      // The ceiling scatters downwards: onto the floor, or past it.
      const float distance = scattered.centre(Plane::DISTANCE, i);
      CHECK(scattered.centre<u32>(Plane::INSTANCE, i) == (std::isinf(distance) ? 0u : 7u));
      if (!std::isinf(distance)) {
        const vec3 p = at3(scattered, Plane::POSITION, i);
        CHECK(std::fabs(p.z) < 1e-4f);
        CHECK(length(p - ceiling) == Approx(distance).epsilon(1e-3));
      }
      CHECK(again.centre(Plane::DISTANCE, i) == distance);
      differ += other.centre(Plane::DISTANCE, i) != distance;
    }
  }
  CHECK(met > 300);
  CHECK(left > 50);
  CHECK(differ > met / 2);
}
