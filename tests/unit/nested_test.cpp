// Transmitting bodies within each other and overlapping: which of them is where, what refracts,
// what passes; against closed forms.
#include "kernels/integrator/path.h"
#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

/// Wide in x and y.
TestMesh slab(float bottom, float top) { return block({-30, -30, bottom}, {30, 30, top}); }

MaterialView clear(float ior, i32 priority) {
  MaterialView m = standard_material();
  m.constant.base_color = vec3(1);
  m.constant.roughness = 0;
  m.constant.transmission = 1;
  m.constant.ior = ior;
  m.priority = priority;
  return m;
}
MaterialView absorbing(float ior, i32 priority) {
  MaterialView m = clear(ior, priority);
  m.constant.attenuation_color = vec3(0.5f);
  m.constant.attenuation_distance = 1;
  return m;
}

/// What layers between faces of these indices let through at normal incidence, all bounces counted;
/// layer i lets passing[i] of the light through.
double through_layers(const std::vector<double>& ior, const std::vector<double>& passing) {
  double through = 1, back = 0;  // of the stack so far; back: reflectance from below
  for (std::size_t i = 0; i + 1 < ior.size(); ++i) {
    const double r = (ior[i] - ior[i + 1]) / (ior[i] + ior[i + 1]);
    const double left = i > 0 ? passing[i - 1] : 1;
    const double below = r * r, above = back * left * left;
    const double loops = 1 / (1 - above * below);
    through *= left * (1 - below) * loops;
    back = below + (1 - below) * (1 - below) * above * loops;
  }
  return through;
}

/// Three standard deviations of what seen_through() estimates.
constexpr double kNoise = 6e-3;

struct Slab {
  float bottom, top;
  MaterialView material;
};
/// Radiance that comes up through slabs from a lamp of radiance 1 below them.
float seen_through(const std::vector<Slab>& slabs, float eye = 5) {
  TestScene scene;
  for (const Slab& s : slabs) {
    scene.add_instance(scene.add(slab(s.bottom, s.top)), scene.add(s.material));
  }
  scene.add_instance(scene.add(rectangle(30, 30)), scene.add(emitter(vec3(1))),
                     pose(mat3(1), {0, 0, -3}));
  const CameraView camera = look_at({0.1f, 0.2f, eye}, {0.1f, 0.2f, -3}, {1, 1}, 0.002f);
  return mean_beauty(scene.finish(), camera, standard_settings(64), 16384).y;
}

}  // namespace

TEST_CASE("nested: water that overlaps a wall of glass is as if it touched it") {
  const double water = 1.33, glass = 1.5;
  const double touching = through_layers({1, water, glass, 1}, {1, 1});
  const std::vector<Slab> wall_wins{{0.9f, 2, clear(1.33f, 0)}, {0, 1, clear(1.5f, 1)}};
  CHECK(double(seen_through(wall_wins)) == Approx(touching).epsilon(kNoise));
  const std::vector<Slab> other_order{wall_wins[1], wall_wins[0]};
  CHECK(double(seen_through(other_order)) == Approx(touching).epsilon(kNoise));
  const std::vector<Slab> water_wins{{0.9f, 2, clear(1.33f, 7)}, {0, 1, clear(1.5f, -2)}};
  CHECK(double(seen_through(water_wins)) == Approx(touching).epsilon(kNoise));
  // From within the overlap: all of it is glass.
  const double from_wall = glass * glass * through_layers({glass, 1}, {});
  CHECK(double(seen_through(wall_wins, 0.95f)) == Approx(from_wall).epsilon(kNoise));
  // That differs from two faces with air between them.
  CHECK(touching > 1.01 * through_layers({1, water, 1, glass, 1}, {1, 1, 1}));
}

TEST_CASE("nested: light is absorbed by what is really there") {
  const auto left = [](double distance) { return std::pow(0.5, distance); };
  const std::vector<Slab> wall_wins{{0.5f, 2, absorbing(1.33f, 0)}, {0, 1, clear(1.5f, 1)}};
  CHECK(double(seen_through(wall_wins)) ==
        Approx(through_layers({1, 1.33, 1.5, 1}, {left(1), 1})).epsilon(kNoise));
  const std::vector<Slab> water_wins{{0.5f, 2, absorbing(1.33f, 1)}, {0, 1, clear(1.5f, 0)}};
  CHECK(double(seen_through(water_wins)) ==
        Approx(through_layers({1, 1.33, 1.5, 1}, {left(1.5), 1})).epsilon(kNoise));
}

TEST_CASE("nested: a bubble of air in water, and an ice cube that equals it") {
  const std::vector<Slab> bubble{{0, 2, absorbing(1.33f, 1)}, {0.5f, 1, clear(1, 2)}};
  CHECK(double(seen_through(bubble)) ==
        Approx(through_layers({1, 1.33, 1, 1.33, 1}, {0.5, 1, std::sqrt(0.5)})).epsilon(kNoise));
  // Of equal priority, what is entered last fills the place.
  std::vector<Slab> inner = bubble;
  inner[1].material.priority = 1;
  CHECK(seen_through(inner) == seen_through(bubble));
  // What is lower and wholly inside is not there at all.
  inner[1].material.priority = 0;
  CHECK(double(seen_through(inner)) ==
        Approx(through_layers({1, 1.33, 1}, {0.25})).epsilon(kNoise));
}

TEST_CASE("nested: Snell's law with the indices of both sides") {
  const MaterialValues m = clear(1.5f, 0).constant;
  for (const bool front : {true, false}) {
    for (const float outside : {1.33f, 1.8f}) {
      const float near = front ? outside : 1.5f, far = front ? 1.5f : outside;
      const vec3 wo(0.6f, 0, front ? 0.8f : -0.8f), n(0, 0, 1);
      ShadingPoint at{wo, n, n};
      at.outside = outside;
      const Bsdf b = make_bsdf(m, at);
      CHECK(b.eta == Approx(double(far / near)));
      BsdfSample s;
      REQUIRE(sample_bsdf(b, 0.999f, vec2(0.5f), s));
      REQUIRE(s.lobe == Lobe::kTransmission);
      CHECK(-s.wi.x * far == Approx(double(wo.x * near)).epsilon(1e-5));
      CHECK(s.wi.z * wo.z < 0);
      const float r = fresnel_dielectric(0.8f, far / near).reflectance;
      CHECK(s.weight.x * sqr(s.eta) == Approx(1).epsilon(1e-4));
      REQUIRE(sample_bsdf(b, 0.5f * r, vec2(0.5f), s));
      CHECK(s.lobe == Lobe::kGlossy);
    }
  }
}

TEST_CASE("nested: plastic in water reflects by the ratio of indices") {
  MaterialValues m = standard_material().constant;
  m.base_color = vec3(0);
  m.roughness = 0.5f;
  const vec3 n(0, 0, 1);
  ShadingPoint at{n, n, n};
  const float dry = evaluate_bsdf(make_bsdf(m, at), n).glossy.x;
  at.outside = 1.33f;
  const float wet = evaluate_bsdf(make_bsdf(m, at), n).glossy.x;
  CHECK(wet / dry == Approx(std::pow(0.17 / 2.83, 2) / 0.04).epsilon(0.05));
  at.outside = 1.5f;
  CHECK(evaluate_bsdf(make_bsdf(m, at), n).glossy.x < 0.02f * dry);
}

TEST_CASE("nested: glass, water and ice that overlap vanish in a furnace") {
  for (const float roughness : {0.0f, 0.3f}) {
    TestScene scene;
    const u32 ball = scene.add(sphere(24));
    MaterialView ice = clear(1.31f, 2);
    ice.constant.roughness = roughness;
    scene.add_instance(ball, scene.add(clear(1.5f, 1)));
    scene.add_instance(ball, scene.add(clear(1.33f, 3)), pose(mat3(0.7f), {0, 0, 0.2f}));
    scene.add_instance(ball, scene.add(ice), pose(mat3(0.4f), {0.1f, 0.2f, 0.6f}));
    scene.set_dome(vec3(1));
    const CameraView camera = look_at({0, 0.5f, 4}, {0, 0, 0}, {8, 8}, 0.28f);
    const float got = mean_beauty(scene.finish(), camera, standard_settings(400), 512).y;
    CHECK(std::fabs(got - 1) < 0.01f);
  }
}

TEST_CASE("nested: light from a lamp inside passes surfaces that are absent") {
  float results[2];
  for (const bool hidden : {false, true}) {
    TestScene scene;
    scene.add_instance(scene.add(block({-3, -3, -1}, {3, 3, 3})), scene.add(clear(1.4f, 1)));
    scene.add_instance(scene.add(rectangle(2, 2)), scene.add(lambert(vec3(0.5f))));
    const u32 lamp =
        scene.add_instance(scene.add(rectangle(0.5f, 0.5f)), scene.add(emitter(vec3(4))),
                           pose(rotation({1, 0, 0}, kPi), {0, 0, 2}));
    scene.add_light(lamp);
    if (hidden)
      scene.add_instance(scene.add(block({-1, -1, 0.5f}, {1, 1, 1})),
                         scene.add(absorbing(1.7f, 0)));
    // The eye is in the water.
    const CameraView camera = look_at({1.5f, 0, 1.5f}, {0.5f, 0.1f, 0}, {4, 4}, 0.1f);
    results[hidden] = mean_beauty(scene.finish(), camera, standard_settings(2), 1024).y;
  }
  CHECK(results[0] > 0.05f);
  CHECK(results[1] == Approx(double(results[0])).epsilon(1e-3));
}

TEST_CASE("nested: bodies are kept by priority, four of them") {
  TestScene scene;
  const u32 mesh = scene.add(rectangle(1, 1));
  const i32 priorities[] = {0, 5, -1, 5, 9};
  for (u32 i = 0; i < 5; ++i)
    scene.add_instance(mesh, scene.add(clear(1.1f + 0.1f * float(i), priorities[i])));
  const SceneView& view = scene.finish();
  CHECK(view.any_priority);
  const vec3 in(0, 0, -1), out(0, 0, 1);
  Inside inside;
  const auto surface = [&](u32 i) { return locate(view, i, 0, vec2(0.3f), 0); };
  const auto cross = [&](u32 i, vec3 d) {
    const Surface s = surface(i);
    cross_surface(inside, s, s.material->constant, d);
  };
  const auto met = [&](u32 i, vec3 d) { return boundary_at(view, inside, surface(i), d); };
  CHECK(met(1, in).outside == 1);
  for (u32 i = 0; i < 4; ++i) cross(i, in);
  CHECK(inside.layers[0].ior == Approx(1.3));
  CHECK(inside.layers[3].ior == Approx(1.4));  // of the two of priority 5 the last
  CHECK(met(0, out).meeting == Meeting::kAbsent);
  CHECK(met(1, out).meeting == Meeting::kAbsent);
  CHECK(met(0, in).meeting == Meeting::kAbsent);
  CHECK(met(3, out).meeting == Meeting::kScatters);
  CHECK(met(3, out).outside == Approx(1.2));
  CHECK(met(4, in).outside == Approx(1.4));
  cross(4, in);  // one too many: the path is not inside of it
  CHECK(inside.depth == kMaxMediumDepth);
  CHECK(met(4, out).outside == Approx(1.4));
  cross(3, out);
  CHECK(met(1, out).outside == Approx(1.1));
}
