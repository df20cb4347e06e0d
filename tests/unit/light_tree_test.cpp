// Light trees: what they may leave out, what their probabilities sum to, what they gain.
#include "renderer/lights/light_tree.h"

#include <tbb/global_control.h>

#include "kernels/light/light.h"
#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"
#include "tests/unit/moments.h"
#include "tests/unit/random.h"
#include "tests/unit/test_scene.h"

using namespace heliograph::test;
using heliograph::resident::build_light_tree;
using heliograph::resident::LightTree;

namespace {

vec3 direction(Random& random) { return sample_sphere(random.next2()); }
vec3 in_box(Random& random, float half) {
  const vec2 xy = random.next2();
  return half * (2.0f * vec3(xy, random.next()) - 1.0f);
}

/// A small triangle anywhere in the unit box.
struct Emitter {
  vec3 a, b, c;
};
std::vector<Emitter> emitters(u32 count, float size, Random& random) {
  std::vector<Emitter> made;
  for (u32 i = 0; i < count; ++i) {
    const vec3 a = in_box(random, 1);
    made.push_back({a, a + size * direction(random), a + size * direction(random)});
  }
  return made;
}
std::vector<LightBounds> bounds_of(const std::vector<Emitter>& emitters, Random& random) {
  std::vector<LightBounds> bounds;
  for (const Emitter& e : emitters) {
    bounds.push_back(triangle_bounds(e.a, e.b, e.c));
    bounds.back().power *= 0.1f + random.next();
    bounds.back().two_sided = random.next() < 0.1f;
  }
  return bounds;
}

Receiver random_receiver(Random& random) {
  const float kind = random.next();
  const Facing facing = kind < 0.5f ? Facing::kFront : kind < 0.8f ? Facing::kBoth : Facing::kAny;
  const vec3 p = in_box(random, 1.5f);
  return {p, direction(random), facing, 0, 1};
}

double sum_of_probabilities(const LightTree& tree, const Receiver& r) {
  double sum = 0;
  for (u32 i = 0; i < tree.nodes.size(); ++i)
    if (tree.nodes[i].count > 0) sum += double(leaf_probability(tree.nodes.data(), i, r, false));
  return sum;
}

/// Puts the tree that the backend builds in place of the scene's own.
void use_built_tree(TestScene& scene, LightTree& tree) {
  tree = build_light_tree(scene.light_bounds, 1);
  for (u32 i = 0; i < tree.nodes.size(); ++i) {
    LightNode& node = tree.nodes[i];
    if (node.count == 0) continue;
    node.first = tree.order[node.first];
    scene.lights[node.first].leaf = i;
  }
  scene.view.light_nodes = tree.nodes.data();
}

}  // namespace

TEST_CASE("light tree: probabilities of all leaves sum to 1, with up to 100,000 emitters") {
  Random random;
  for (const u32 count : {1u, 2u, 3u, 17u, 1000u, 100000u}) {
    for (const u32 leaf_size : {1u, 4u}) {
      const auto bounds = bounds_of(emitters(count, 0.02f, random), random);
      const LightTree tree = build_light_tree(bounds, leaf_size);
      auto order = tree.order;
      std::sort(order.begin(), order.end());
      for (u32 i = 0; i < count; ++i) REQUIRE(order[i] == i);
      for (int k = 0; k < (count > 1000 ? 2 : 20); ++k) {
        CHECK(sum_of_probabilities(tree, random_receiver(random)) == Approx(1).epsilon(1e-4));
      }
    }
  }
}

TEST_CASE("light tree: leaves come as often as their probability says (1e-6)") {
  Random random;
  const LightTree tree = build_light_tree(bounds_of(emitters(300, 0.1f, random), random), 1);
  for (int k = 0; k < 4; ++k) {
    const Receiver r = random_receiver(random);
    const int samples = 200000;
    std::vector<double> counts(tree.nodes.size()), expected(tree.nodes.size());
    for (int i = 0; i < samples; ++i) {
      LeafChoice choice{0, 1, random.next()};
      choose_leaf(tree.nodes.data(), r, false, choice);
      counts[choice.node] += 1;
      CHECK(choice.probability ==
            Approx(leaf_probability(tree.nodes.data(), choice.node, r, false)).epsilon(1e-4));
    }
    for (u32 i = 0; i < tree.nodes.size(); ++i)
      if (tree.nodes[i].count > 0)
        expected[i] = samples * double(leaf_probability(tree.nodes.data(), i, r, false));
    CHECK(chi2_p_value(counts, expected) > 1e-6);
  }
}

TEST_CASE("light tree: what sends light to a point has a probability there") {
  Random random;
  const auto shapes = emitters(400, 0.4f, random);
  const auto bounds = bounds_of(shapes, random);
  for (const u32 leaf_size : {1u, 4u}) {
    const LightTree tree = build_light_tree(bounds, leaf_size);
    int lit = 0;
    for (u32 n = 0; n < tree.nodes.size(); ++n) {
      for (u32 k = 0; k < tree.nodes[n].count; ++k) {
        const u32 element = tree.order[tree.nodes[n].first + k];
        const Emitter& e = shapes[element];
        for (int round = 0; round < 50; ++round) {
          const Receiver r = random_receiver(random);
          const vec2 u = sample_triangle(random.next2());
          const vec3 d = normalize(e.a + u.x * (e.b - e.a) + u.y * (e.c - e.a) - r.p);
          float leaves = -dot(d, normalize(cross(e.b - e.a, e.c - e.a)));
          float arrives = r.facing == Facing::kAny ? 1 : dot(d, r.n);
          if (bounds[element].two_sided) leaves = std::fabs(leaves);
          if (r.facing == Facing::kBoth) arrives = std::fabs(arrives);
          if (leaves < 1e-4f || arrives < 1e-4f) continue;
          ++lit;
          REQUIRE(leaf_probability(tree.nodes.data(), n, r, false) > 0);
        }
      }
    }
    CHECK(lit > 3000);
  }
}

TEST_CASE("light tree: the same tree whatever the threads") {
  Random random;
  const auto bounds = bounds_of(emitters(20000, 0.02f, random), random);
  const LightTree many = build_light_tree(bounds, 1);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const LightTree single = build_light_tree(bounds, 1);
  CHECK(many.order == single.order);
  for (u32 i = 0; i < many.nodes.size(); ++i) {
    REQUIRE(many.nodes[i].first == single.nodes[i].first);
    REQUIRE(many.nodes[i].power == single.nodes[i].power);
    REQUIRE(many.nodes[i].cos_spread == single.nodes[i].cos_spread);
  }
}

TEST_CASE("light tree: 1,000 emitters: the mean of uniform choice, a tenth of its variance") {
  Random random;
  TestScene scene;
  const u32 mesh = scene.add(rectangle(0.02f, 0.02f));
  const u32 material = scene.add(emitter(vec3(1)));
  for (u32 i = 0; i < 1000; ++i) {
    const mat3 turn = rotation(direction(random), 6 * random.next());
    scene.add_light(scene.add_instance(mesh, material, pose(turn, in_box(random, 2))));
  }
  scene.finish();
  LightTree tree;
  use_built_tree(scene, tree);
  double ratio = 0;
  const int receivers = 20;
  for (int k = 0; k < receivers; ++k) {
    const vec3 p = in_box(random, 2);
    const Receiver r = receiver_at(scene.view, p, direction(random), Facing::kFront, 0);
    Moments by_tree, uniform;
    for (int i = 0; i < 40000; ++i) {
      LightSample s;
      const bool found = sample_light(scene.view, r, random.next2(), s);
      by_tree.add(found ? double(max2(dot(s.direction, r.n), 0.0f) / s.pdf) : 0);
      const u32 light = min2(u32(random.next() * 1000), 999u);
      const LeafChoice choice{scene.lights[light].leaf, 1e-3f, random.next()};
      const bool hit = sample_surface_light(scene.view, r, choice, random.next(), s);
      uniform.add(hit ? double(max2(dot(s.direction, r.n), 0.0f) / s.pdf) : 0);
    }
    const double error = std::sqrt((by_tree.variance() + uniform.variance()) / 40000);
    INFO("receiver " << k << ": " << by_tree.mean() << " and " << uniform.mean());
    CHECK(std::fabs(by_tree.mean() - uniform.mean()) < 5 * error);
    ratio += uniform.variance() / by_tree.variance() / receivers;
    CHECK(uniform.variance() > 3 * by_tree.variance());
  }
  CHECK(ratio > 10);
}
