// Light inside bodies: the walk against theory, furnaces, and the limit of a radius of nothing.
#include "kernels/integrator/subsurface.h"

#include "tests/unit/catch.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

MaterialView body(vec3 color, vec3 radius, float specular = 0) {
  MaterialView m = standard_material();
  m.constant.specular = specular;
  m.constant.subsurface = 1;
  m.constant.subsurface_color = color;
  m.constant.subsurface_radius = radius;
  return m;
}

/// All below z = 0.
struct HalfSpace {
  Hit closest(const Ray& ray, u32) const { return closest_in(0, ray); }
  bool occluded(const Ray&, u32) const { return false; }
  Hit closest_in(u32 instance, const Ray& ray) const {
    const float t = -ray.origin.z / ray.direction.z;
    if (ray.direction.z > 0 && t < ray.t_max) return {t, instance, 0, 0, 0};
    return {INFINITY, kNone, 0, 0, 0};
  }
};

/// Mean radiance of a picture that an instance of the mesh fills, under a uniform sky.
vec3 furnace(TestMesh mesh, const MaterialView& material, u32 samples = 512) {
  TestScene scene;
  scene.add_instance(scene.add(std::move(mesh)), scene.add(material));
  scene.set_dome(vec3(1));
  const CameraView camera = look_at({0, 0, 4}, {0, 0, 0}, {8, 8}, 0.28f);
  Settings settings = standard_settings(8);
  settings.seed = 3;
  return mean_beauty(scene.finish(), camera, settings, samples);
}

void check(vec3 got, vec3 expected, double tolerance) {
  for (int c = 0; c < 3; ++c) {
    CHECK(double(got[c]) == Approx(double(expected[c])).margin(tolerance));
  }
}

}  // namespace

TEST_CASE("subsurface: a half-space gives off its colour") {
  Random random;
  MaterialValues m = body(vec3(0), vec3(1, 0.3f, 0.1f)).constant;
  const vec3 colors[] = {{0.1f, 0.3f, 0.6f}, {0.5f, 0.8f, 0.9f}, {0.95f, 0.02f, 0.99f}};
  for (const vec3 color : colors) {
    m.subsurface_color = color;
    const Interior medium = body_medium(m, 1e-6f);
    glm::dvec3 sum(0);
    constexpr int kWalks = 40000;
    for (int i = 0; i < kWalks; ++i) {
      const vec3 d = -sample_cosine(random.next2());
      const Ray ray{{0, 0, -1e-6f}, d, INFINITY, 0, {0, false}};
      const Walk walk = walk_body(HalfSpace{}, 0, medium, ray, {u32(i) * 977u});
      if (walk.hit.instance != kNone) sum += glm::dvec3(walk.weight);
    }
    check(vec3(sum / double(kWalks)), color, 0.01);
  }
}

TEST_CASE("subsurface: a white half-space loses less than 1 % in walks that are too long") {
  const Interior medium = body_medium(body(vec3(1), vec3(1)).constant, 1e-6f);
  Random random;
  double sum = 0;
  constexpr int kWalks = 4000;
  for (int i = 0; i < kWalks; ++i) {
    const Ray ray{{0, 0, -1e-6f}, -sample_cosine(random.next2()), INFINITY, 0, {0, false}};
    const Walk walk = walk_body(HalfSpace{}, 0, medium, ray, {u32(i) * 977u});
    if (walk.hit.instance != kNone) sum += double(walk.weight.y);
  }
  CHECK(sum / kWalks > 0.99);
  CHECK(sum / kWalks < 1.0001);
}

TEST_CASE("subsurface: a white body vanishes in a furnace") {
  MaterialView layered = body(vec3(1), vec3(0.2f), 1);
  layered.constant.clearcoat = 0.7f;
  layered.constant.sheen = 0.5f;
  MaterialView half = body(vec3(1), vec3(0.2f), 1);
  half.constant.subsurface = 0.5f;
  half.constant.base_color = vec3(1);
  for (const MaterialView& m :
       {body(vec3(1), vec3(0.1f)), body(vec3(1), vec3(0.2f), 1), layered, half}) {
    check(furnace(sphere(24), m, 1024), vec3(1), 0.01);
  }
  // Colours that go unlike ways have more noise: a standard error of 0.2 %.
  check(furnace(sphere(24), body(vec3(1), vec3(3, 0.3f, 0.03f)), 8192), vec3(1), 0.01);
}

TEST_CASE("subsurface: a thick body has the colour asked for") {
  const vec3 color(0.9f, 0.5f, 0.2f);
  check(furnace(rectangle(30, 30), body(color, vec3(0.02f, 0.01f, 0.005f)), 2048), color, 0.015);
}

TEST_CASE("subsurface: a body without a way inside is diffuse") {
  MaterialView diffuse = lambert(vec3(0.7f, 0.5f, 0.3f));
  diffuse.constant.specular = 1;
  const auto picture = [](const MaterialView& m) {
    TestScene scene;
    scene.add_instance(scene.add(sphere(24)), scene.add(m));
    scene.suns.push_back({.direction = normalize(vec3(1, 0.3f, 0.4f)),
                          .one_minus_cos = 1e-3f,
                          .radiance = vec3(100),
                          .probability = 1,
                          .visibility = kAllRays});
    return mean_beauty(scene.finish(), look_at({0, 0, 4}, {0, 0, 0}, {8, 8}, 0.6f),
                       standard_settings(2), 512);
  };
  const vec3 expected = picture(diffuse);
  const MaterialView none = body(diffuse.constant.base_color, vec3(0), 1);
  check(picture(none), expected, 1e-5);
  check(picture(body(diffuse.constant.base_color, vec3(1e-5f), 1)), expected, 0.01 * expected.x);
  MaterialView sheet = body(diffuse.constant.base_color, vec3(0.5f), 1);
  sheet.thin_walled = true;
  check(picture(sheet), expected, 1e-5);
  // And one with a way inside is not: light comes round.
  CHECK(std::fabs(picture(body(diffuse.constant.base_color, vec3(0.5f), 1)).x - expected.x) >
        0.05f * expected.x);
}

TEST_CASE("subsurface: as much light goes from one place to another as comes back") {
  TestScene scene;
  TestMesh pear = sphere(12, false);
  for (vec3& p : pear.positions) p *= vec3(vec2(p.z > 0 ? 0.4f : 1.0f), 1.3f);
  scene.add_instance(scene.add(std::move(pear)), scene.add(body(vec3(1), vec3(1))));
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  MaterialValues m = view.materials[0].constant;
  m.subsurface_color = vec3(0.9f, 0.8f, 0.5f);
  m.subsurface_radius = vec3(0.4f, 0.6f, 0.3f);
  const Interior medium = body_medium(m, 1e-6f);
  const auto top = [](const Surface& s) { return s.p.z > 0.5f; };
  Random random;
  glm::dvec3 flux[2] = {glm::dvec3(0), glm::dvec3(0)};
  for (u32 primitive = 0; primitive < view.meshes[0].triangle_count; ++primitive) {
    const Corners c = corners_at(view.meshes[0], view.meshes[0].triangles[primitive], 0);
    const double area = 0.5 * double(length(cross(c.ab, c.ac)));
    for (u32 i = 0; i < 2000; ++i) {
      const Surface s = locate(view, 0, primitive, sample_triangle(random.next2()), 0);
      const vec3 d = -to_world(make_frame(s.ng), sample_cosine(random.next2()));
      const Ray ray{offset_point(s, d), d, INFINITY, 0, {0, false}};
      const Walk walk = walk_body(tracer, 0, medium, ray, {hash32(primitive * 2000 + i)});
      if (walk.hit.instance == kNone) continue;
      const Surface e = locate(view, 0, walk.hit.primitive, vec2(walk.hit.u, walk.hit.v), 0);
      if (top(s) != top(e)) flux[top(s)] += glm::dvec3(walk.weight) * area;
    }
  }
  // Standard error of each below 1 %.
  for (int c = 0; c < 3; ++c) CHECK(flux[0][c] == Approx(flux[1][c]).epsilon(0.03));
}

TEST_CASE("subsurface: the planes of light sum to beauty") {
  TestScene scene;
  MaterialView m = body(vec3(0.8f, 0.6f, 0.4f), vec3(0.3f), 1);
  m.constant.subsurface = 0.7f;
  scene.add_instance(scene.add(sphere(24)), scene.add(m));
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(lambert(vec3(0.5f))),
                     pose(mat3(1), {0, 0, -1}));
  scene.set_dome(vec3(1, 2, 3));
  const SceneView& view = scene.finish();
  const TestTracer tracer(view);
  const TestFilm film({1, 1}, kBeauty | kLightPlaneSet);
  const CameraView camera = look_at({4, 0, 1}, {0, 0, 0}, {1, 1}, 0.3f);
  render_pixel(view, camera, standard_settings(6), tracer, film.view, 0, 0, 0, 2048);
  const auto mean = [&](Plane plane, int c) { return film.mean(plane, u64(c), 2048); };
  for (int c = 0; c < 3; ++c) {
    double sum = 0;
    for (u32 i = 0; i < kLightPlanes; ++i) {
      sum += double(mean(Plane(u32(Plane::DIRECT_DIFFUSE) + i), c));
    }
    CHECK(sum == Approx(double(mean(Plane::BEAUTY, c))).epsilon(1e-4));
    CHECK(mean(Plane::DIRECT_SUBSURFACE, c) > mean(Plane::INDIRECT_SUBSURFACE, c));
    CHECK(mean(Plane::INDIRECT_SUBSURFACE, c) > 0);
    CHECK(mean(Plane::DIRECT_DIFFUSE, c) > 0);
  }
}

TEST_CASE("subsurface: the back of a surface has no body behind it") {
  const vec3 color(0.6f, 0.5f, 0.4f);
  TestMesh below = rectangle(30, 30);
  for (uvec3& t : below.triangles) std::swap(t.y, t.z);
  check(furnace(std::move(below), body(color, vec3(0.1f)), 64), color, 1e-3);
}
