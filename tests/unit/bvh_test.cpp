// Our own BVH against Embree, which the CPU backend uses: the same rays meet the same surfaces.
#include "kernels/bvh/bvh_tracer.h"

#include <cstring>

#include "renderer/backend/embree/top_level.h"
#include "renderer/bvh/accelerator.h"
#include "tests/unit/bvh_scene.h"
#include "tests/unit/plain_rays.h"

using namespace heliograph;
using namespace heliograph::test;
using kernels::Hit;
using kernels::Ray;

namespace {

constexpr u32 kRays = 100'000;  // of each kind and scene
// A ray through an edge may meet either side, or neither. At most one in so many.
constexpr u32 kEdges = 2'000;

bool same(const Hit& a, const Hit& b) {
  constexpr float kRounding = 1e-5f;  // metres, of coordinates of some 10 m
  if (a.instance != b.instance) return false;
  return a.instance == kNone || (a.primitive == b.primitive &&
                                 std::abs(a.t - b.t) <= 1e-4f * std::max(a.t, b.t) + kRounding);
}

/// How many of the rays that `differs` says so of.
template <class F>
u32 count_rays(F&& differs) {
  u32 count = 0;
  for (u32 i = 0; i < kRays; ++i) count += differs() ? 1 : 0;
  return count;
}

/// All four kinds of rays.
void compare(const BothScenes& scenes, Random& random) {
  const auto embree = scenes.embree();
  const auto bvh = scenes.bvh();
  const u32 instances = scenes.view().instance_count;
  u32 met = 0, within = 0;
  const auto mask = [&] {
    return random.next() < 0.5f ? u32(kernels::kAllRays) : 1u << random_below(random, 6);
  };
  const u32 closest = count_rays([&] {
    const Ray ray = random_ray(random, 12);
    const u32 m = mask();
    const Hit hit = embree.closest(ray, m);
    met += hit.instance != kNone;
    return !same(hit, bvh.closest(ray, m));
  });
  const u32 occluded = count_rays([&] {
    const Ray ray = random_ray(random, 12);
    const u32 m = mask();
    return embree.occluded(ray, m) != bvh.occluded(ray, m);
  });
  // Towards the middle of one instance, so that half of them meet it.
  const auto towards = [&](u32 instance) {
    Ray ray = random_ray(random, 12);
    const vec3 at = kernels::pose_at(scenes.view(), scenes.view().instances[instance], ray.time)
                        .world_from_object[3];
    ray.direction = glm::normalize(at + random_vec3(random, 0.6f) - ray.origin);
    ray.t_max *= 2;
    return ray;
  };
  const u32 inside = count_rays([&] {
    const u32 instance = random_below(random, instances);
    const Ray ray = towards(instance);
    const Hit hit = embree.closest_in(instance, ray);
    within += hit.instance != kNone;
    return !same(hit, bvh.closest_in(instance, ray));
  });
  const u32 meets = count_rays([&] {
    const u32 instance = random_below(random, instances);
    Ray ray = random_ray(random, 2);
    ray.direction *= 5 * random.next();
    return embree.meets(instance, ray) != bvh.meets(instance, ray);
  });
  INFO("met " << met << ", within " << within);
  CHECK((met > kRays / 20 && met < kRays));
  CHECK((within > kRays / 5 && within < kRays));
  CHECK(closest <= kRays / kEdges);
  CHECK(occluded <= kRays / kEdges);
  CHECK(inside <= kRays / kEdges);
  CHECK(meets <= kRays / kEdges);
}

}  // namespace

TEST_CASE("bvh: meets what Embree meets") {
  Random random(1);
  SceneKinds kinds;
  TimeSpan span{0, 1};
  SECTION("of all kinds") {}
  SECTION("of many that stand still") {
    kinds = {.count = 2000, .moving = false, .deforming = false, .shapes = false, .holes = false};
    span = {};
  }
  SECTION("of cut-outs and shapes at an instant") {
    kinds = {.count = 100, .moving = false, .deforming = false};
    span = {};
  }
  SECTION("of static ones among all kinds") { kinds = {.count = 80, .fixed = true}; }
  SECTION("of static ones alone") {
    kinds = {.count = 500, .moving = false, .deforming = false, .shapes = false, .fixed = true};
    span = {};
  }
  SECTION("of what moves and deforms alone") {
    kinds = {.count = 60, .shapes = false, .holes = false, .masks = false};
  }
  SECTION("of curves among all kinds") { kinds = {.count = 40, .fixed = true, .curves = true}; }
  SECTION("of curves at an instant") {
    kinds = {.count = 60, .moving = false, .deforming = false, .holes = false, .curves = true};
    span = {};
  }
  const BothScenes scenes(random_scene(random, kinds), span, kinds.fixed ? 1'000'000 : 0);
  CHECK((scenes.bvh_view().fixed.nodes != nullptr) == kinds.fixed);
  const auto& ours = scenes.own().placement().bounds;
  const auto& theirs = scenes.other().placement().bounds;
  // Embree's box of its static group is of the triangles, ours of their meshes' boxes.
  const float rounding = kinds.fixed ? 0.05f : 0.02f;
  CHECK(glm::length(ours.lower - theirs.lower) + glm::length(ours.upper - theirs.upper) <
        rounding * glm::length(theirs.upper - theirs.lower));
  compare(scenes, random);
  CHECK(scenes.view().plain_rays ==
        !(kinds.moving || kinds.deforming || kinds.holes || kinds.curves));
}

TEST_CASE("bvh: plain rays meet what they do in the program for all") {
  Random random(3);
  const SceneKinds kinds{.count = 300, .moving = false, .deforming = false, .holes = false};
  const BothScenes scenes(random_scene(random, kinds), {}, 0);
  REQUIRE(scenes.view().plain_rays);
  const auto all = scenes.bvh();
  u32 met = 0;
  CHECK(count_rays([&] {
          const Ray ray = random_ray(random, 12);
          const Hit hit = closest_plain(scenes.view(), scenes.bvh_view(), ray, kernels::kAllRays);
          const Hit wanted = all.closest(ray, kernels::kAllRays);
          met += hit.instance != kNone;
          return std::memcmp(&hit, &wanted, sizeof hit) != 0;
        }) == 0);
  CHECK(met > kRays / 20);
}

TEST_CASE("bvh: a walk that rests after each step answers as one that does not") {
  Random random(2);
  const BothScenes scenes(random_scene(random, {.count = 30, .fixed = true}), {0, 1}, 1'000'000);
  // Many walks at once, a step each in turn; one that ends starts with another ray.
  constexpr u32 kWalks = 32, kAll = 4096;
  std::vector<Ray> rays;
  for (u32 i = 0; i < kAll; ++i) rays.push_back(random_ray(random, 12));
  std::vector<kernels::BvhStack> stacks(kWalks);
  std::vector<kernels::BvhWalk> walks;
  std::vector<u32> ray_of_walk;
  std::vector<Hit> hits(kAll);
  u32 started = 0;
  for (u32 i = 0; i < kWalks; ++i) {
    walks.emplace_back(scenes.view(), scenes.bvh_view(), stacks[i]);
    walks[i].begin(rays[started], kernels::kAllRays, started % 2);
    ray_of_walk.push_back(started++);
  }
  for (u32 ended = 0; ended < kAll;)
    for (u32 i = 0; i < kWalks; ++i) {
      if (ray_of_walk[i] == kNone || walks[i].step()) continue;
      hits[ray_of_walk[i]] = walks[i].hit();
      ++ended;
      ray_of_walk[i] = started < kAll ? started++ : kNone;
      if (ray_of_walk[i] != kNone)
        walks[i].begin(rays[ray_of_walk[i]], kernels::kAllRays, ray_of_walk[i] % 2);
    }
  const auto tracer = scenes.bvh();
  u32 met = 0;
  for (u32 i = 0; i < kAll; ++i) {
    met += hits[i].instance != kNone;
    if (i % 2) {
      CHECK((hits[i].instance != kNone) == tracer.occluded(rays[i], kernels::kAllRays));
      continue;
    }
    const Hit hit = tracer.closest(rays[i], kernels::kAllRays);
    CHECK((hit.instance == hits[i].instance && hit.primitive == hits[i].primitive));
    CHECK((hit.t == hits[i].t && hit.u == hits[i].u && hit.v == hits[i].v));
  }
  CHECK(met > kAll / 20);
}
