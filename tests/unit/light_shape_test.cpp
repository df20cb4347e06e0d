// Lights that are discs, spheres or spots: densities, closed forms, and that every way of finding
// them agrees.
#include "kernels/light/light_shape.h"

#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

const Receiver kFloor{vec3(0), vec3(0, 0, 1), Facing::kFront, 0, 1};

/// A light of radiance 1 in all channels.
struct Lamp {
  Shape shape;
  mat4x3 pose;
  bool two_sided = false;
  float cone_cos = 0, cone_scale = 0;
};

u32 add_lamp(TestScene& scene, const Lamp& lamp, bool sampled = true) {
  const u32 instance = scene.add_instance(scene.add(unit_shape(lamp.shape)),
                                          scene.add(emitter(vec3(sampled ? 0 : 1))), lamp.pose);
  if (!sampled) return instance;
  LightView& light = scene.add_light(instance, 0, vec3(1));
  light.light_two_sided = lamp.two_sided;
  light.cone_cos = lamp.cone_cos;
  light.cone_scale = lamp.cone_scale;
  return instance;
}

/// Irradiance on a small white floor at the origin, and its standard error in the mean.
double irradiance(TestScene& scene, u32 samples = 65536) {
  scene.add_instance(scene.add(rectangle(1e-3f, 1e-3f)), scene.add(lambert(vec3(1))));
  const SceneView& view = scene.finish();
  const CameraView camera = look_at({0.05f, 0, 0.05f}, {0, 0, 0}, {4, 4}, 0.002f);
  return M_PI * double(mean_beauty(view, camera, standard_settings(2), samples / 16).y);
}

/// The directions of sample_light() from the origin follow light_pdf().
double density_p_value(const SceneView& view) {
  const TestTracer tracer(view);
  const auto direction = [](double x, double y) {
    const double r = std::sqrt(1 - y * y), phi = 2 * M_PI * x;
    return vec3(r * std::cos(phi), r * std::sin(phi), y);
  };
  const auto density = [&](double x, double y) {
    const vec3 d = direction(x, y);
    const Hit hit = tracer.closest({vec3(0), d, INFINITY, 0, {}}, kAllRays);
    return hit.instance == kNone ? 0.0 : 2 * M_PI * double(light_pdf(view, kFloor, hit, d, 0));
  };
  Random random;
  const auto sample = [&](double& x, double& y) {
    LightSample s;
    if (!sample_light(view, kFloor, random.next2(), s)) return false;
    x = std::atan2(double(s.direction.y), double(s.direction.x)) / (2 * M_PI);
    if (x < 0) x += 1;
    y = s.direction.z;
    return y >= 0;
  };
  return square_p_value({24, 40, 100000}, sample, density);
}

mat4x3 facing_down(float size, vec3 at) { return pose(mat3(size), at); }  // -z is down already

}  // namespace

TEST_CASE("shapes: places and points are inverse, spheres outwards, discs along -z") {
  Random random;
  for (int i = 0; i < 1000; ++i) {
    const vec3 n = sample_sphere(random.next2());
    CHECK(length(sphere_point(sphere_place(n)) - n) < 2e-6f);
    const vec2 d = sample_disk(random.next2());
    CHECK(length(disc_point(disc_place(vec3(d, 0))) - vec3(d, 0)) < 1e-6f);
  }
  for (const Shape shape : {Shape::kDisc, Shape::kSphere}) {
    TestScene scene;
    const mat3 linear = rotation({1, 2, 3}, 1) * mat3(2, 0, 0, 0, -0.5f, 0, 0, 0, 1);
    const u32 lamp = add_lamp(scene, {shape, pose(linear, {1, 2, 3})});
    const SceneView& view = scene.finish();
    const TestTracer tracer(view);
    for (int i = 0; i < 1000; ++i) {
      const vec3 origin = vec3(1, 2, 3) + linear * (3.0f * sample_sphere(random.next2()));
      const vec3 target = vec3(1, 2, 3) + linear * vec3(0.5f * sample_disk(random.next2()), 0);
      const vec3 d = normalize(target - origin);
      const Hit hit = tracer.closest({origin, d, INFINITY, 0, {}}, kAllRays);
      REQUIRE(hit.instance == lamp);
      const Surface s = surface_at(view, lamp, 0, {hit.u, hit.v}, 0);
      CHECK(length(s.p - (origin + d * hit.t)) < 1e-5f);
      const bool front = shape == Shape::kSphere ||
                         (view.instances[lamp].object_from_world * vec4(origin, 1)).z < 0;
      CHECK((dot(s.ng, d) < 0) == front);
      const float off = s.offset;
      const Ray out{offset_point(s, -d), -d, INFINITY, 0, {}};
      CHECK(off > 0);
      CHECK(tracer.closest(out, kAllRays).instance == kNone);
    }
  }
}

TEST_CASE("shapes: sampled directions follow the density (1e-6)") {
  const mat3 turn = rotation({1, 0.3f, 0}, 0.5f);
  const mat3 squeeze(1, 0, 0, 0, 0.4f, 0, 0, 0, 0.7f);
  const Lamp lamps[] = {
      {Shape::kSphere, facing_down(0.5f, {0.3f, 0.2f, 1.2f})},
      {Shape::kSphere, pose(turn * squeeze, {0.3f, 0.2f, 1.5f})},
      {Shape::kSphere, facing_down(0.02f, {0.1f, 0, 0.1f})},
      {Shape::kSphere, facing_down(3, {0.1f, 0, 0.1f}), true},  // from within
      {Shape::kDisc, pose(turn, {0.3f, 0.2f, 0.6f})},
      {Shape::kDisc, pose(turn * squeeze, {0.5f, 0.2f, 3})},
  };
  for (const Lamp& lamp : lamps) {
    TestScene scene;
    add_lamp(scene, lamp);
    INFO("lamp " << &lamp - lamps);
    CHECK(density_p_value(scene.finish()) > kLevel);
  }
}

TEST_CASE("shapes: irradiance has its closed form, near and far (0.5 %)") {
  for (const float z : {0.6f, 2.0f, 40.0f}) {
    INFO("z " << z);
    // A sphere above the horizon: pi L (r / d)^2; a disc that faces: pi L r^2 / (r^2 + d^2).
    TestScene sphere, disc, tilted;
    add_lamp(sphere, {Shape::kSphere, facing_down(0.5f, {0, 0, z})});
    CHECK(irradiance(sphere) == Approx(M_PI * sqr(0.5f / z)).epsilon(0.005));
    add_lamp(disc, {Shape::kDisc, facing_down(0.5f, {0, 0, z})});
    CHECK(irradiance(disc) == Approx(M_PI * 0.25f / (0.25f + z * z)).epsilon(0.005));
    // A sphere off to the side counts by the cosine to its centre.
    const float side = 0.7f * z;
    add_lamp(tilted, {Shape::kSphere, facing_down(0.5f, {side, 0, z})});
    const float d2 = side * side + z * z;
    CHECK(irradiance(tilted) == Approx(M_PI * 0.25f / d2 * z / std::sqrt(d2)).epsilon(0.005));
  }
}

TEST_CASE("shapes: lights sampled, met by chance, or both weighted: one mean (1 %)") {
  const mat3 turn = rotation({1, 0.3f, 0}, 0.7f);
  for (const Shape shape : {Shape::kDisc, Shape::kSphere}) {
    double results[3];
    for (int strategy = 0; strategy < 3; ++strategy) {
      TestScene scene;
      const Lamp lamp{shape, pose(turn * mat3(0.8f), {0.4f, -0.3f, 1.1f})};
      const u32 instance = add_lamp(scene, lamp, strategy > 0);
      // Lights that glossy rays do not meet are sampled alone; the floor has no gloss.
      if (strategy == 1) scene.instances[instance].visibility = kAllRays & ~kGlossyRay;
      results[strategy] = irradiance(scene);
    }
    INFO(results[0] << " " << results[1] << " " << results[2]);
    CHECK(results[1] == Approx(results[0]).epsilon(0.01));
    CHECK(results[2] == Approx(results[1]).epsilon(0.01));
  }
}

TEST_CASE("shapes: in a furnace of their own radiance nothing shows") {
  for (const Shape shape : {Shape::kDisc, Shape::kSphere}) {
    TestScene scene;
    add_lamp(scene, {shape, facing_down(0.3f, {0, 0, 0.8f}), true});
    scene.add_instance(scene.add(rectangle(2, 2)), scene.add(lambert(vec3(1))));
    scene.set_dome(vec3(1));
    const SceneView& view = scene.finish();
    const CameraView camera = look_at({0, -2, 1.4f}, {0, 0, 0.3f}, {8, 8}, 0.9f);
    CHECK(mean_beauty(view, camera, standard_settings(3), 512).y == Approx(1).epsilon(0.01));
  }
}

TEST_CASE("shapes: a spot's profile is glTF's, whoever finds it") {
  const float inner = 0.3f, outer = 0.6f;
  const float cosine = std::cos(outer), scale = 1 / (std::cos(inner) - cosine);
  for (const float angle : {0.0f, 0.25f, 0.4f, 0.55f, 0.65f, 2.0f}) {
    INFO("angle " << angle);
    TestScene scene;
    const mat3 turn = rotation({0, 1, 0}, angle);
    add_lamp(scene, {Shape::kSphere, pose(turn * mat3(0.01f), {0, 0, 2}), false, cosine, scale});
    const float share = sqr(clamp01((std::cos(angle) - cosine) * scale));
    CHECK(irradiance(scene, 4096) == Approx(M_PI * 0.01 * 0.01 / 4 * share).epsilon(0.02));
    const SceneView& view = scene.view;
    const TestTracer tracer(view);
    const Hit hit = tracer.closest({vec3(0, 0, 0.1f), vec3(0, 0, 1), INFINITY, 0, {}}, kAllRays);
    REQUIRE(hit.instance == 0);
    const Surface s = surface_at(view, 0, 0, {hit.u, hit.v}, 0);
    const vec3 seen = emitted(view, s, material_at(view, s, ~0u), vec3(0, 0, -1));
    CHECK(seen.y == Approx(share).margin(1e-5));
    LightSample sample;
    if (share == 0) CHECK_FALSE(sample_light(view, kFloor, {0.4f, 0.6f}, sample));
  }
}
