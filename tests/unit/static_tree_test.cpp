// Static entities in one tree: which they are, what rays meet of them, and what an edit makes anew.
#include "renderer/bvh/static_tree.h"

#include "tests/unit/bvh_scene.h"

using namespace heliograph;
using namespace heliograph::test;
using bvh::StaticGroup;
using kernels::Hit;
using kernels::Ray;

namespace {

constexpr u64 kMost = 1'000'000;  // triangles

PutEntity fixed() {
  PutEntity put;
  put.is_static = true;
  return put;
}

/// On a grid of 8 columns, 2 m wide.
vec3 place_of(u32 i) {
  const u32 row = i / 8;
  return {2 * float(i % 8), 2 * float(row), 0};
}

/// Pairs of a static object and one that may move in the same place, each third time with another
/// static one there. Which comes first takes turns.
Edits twins(u32 pairs) {
  Edits edits;
  edits.mesh("cube", cube());
  for (u32 i = 0; i < pairs; ++i) {
    const auto put = [&](const char* kind, bool is_static) {
      const std::string name = fmt::format("{} {}", kind, i);
      edits.object(name, "cube", translation(place_of(i)));
      if (is_static) edits.put(name, fixed());
    };
    if (i % 2) put("loose", false);
    put("fixed", true);
    if (i % 2 == 0) put("loose", false);
    if (i % 3 == 0) put("also fixed", true);
  }
  return edits;
}

/// A store of our own trees.
struct Own {
  explicit Own(u64 most = kMost) : accelerator(most) {}
  std::shared_ptr<const resident::ResidentScene> operator()(
      const std::shared_ptr<const Snapshot>& snapshot) {
    auto made = store.prepare(snapshot, {}, Interrupt{});
    REQUIRE(made);
    return *made;
  }
  bvh::BvhAccelerator accelerator;
  resident::DerivedCache cache{1u << 30};
  resident::SceneStore store{accelerator, cache, 1u << 30};
};

std::shared_ptr<const StaticGroup> group_of(const resident::ResidentScene& scene) {
  return bvh::bvh_of(scene.placement())->fixed();
}

/// Rays that do not meet the same, bit by bit.
u32 differing(const resident::ResidentScene& a, const resident::ResidentScene& b) {
  const kernels::BvhView views[]{bvh::world_view(a.placement()), bvh::world_view(b.placement())};
  const kernels::BvhTracer first(a.view(), views[0]), second(b.view(), views[1]);
  Random random(3);
  u32 differ = 0;
  for (u32 i = 0; i < 20'000; ++i) {
    const Ray ray = random_ray(random, 12);
    const u32 mask = i % 2 ? u32(kernels::kAllRays) : 1u << (i / 2 % 6);
    const Hit x = first.closest(ray, mask), y = second.closest(ray, mask);
    differ += x.t != y.t || x.instance != y.instance || x.primitive != y.primitive || x.u != y.u ||
              x.v != y.v || first.occluded(ray, mask) != (x.instance != kNone);
  }
  return differ;
}

}  // namespace

TEST_CASE("static tree: its members are those of Embree's group") {
  Random random(1);
  const auto scene = random_scene(random, {.count = 60, .fixed = true});
  for (const u64 most : {u64(0), u64(500), u64(3000), kMost})
    for (const TimeSpan span : {TimeSpan{0, 1}, TimeSpan{0.5, 0.5}}) {
      const BothScenes scenes(scene, span, most);
      const auto own = group_of(scenes.own());
      const auto& top =
          static_cast<const embree::TopLevel&>(*scenes.other().placement().accelerator);
      REQUIRE(bool(own) == bool(top.group));
      CHECK(bool(own) == (most > 500));
      if (!own) continue;
      CHECK(own->slots == top.group->slots);
      u32 bits = 0;
      for (u32 i = 0; i < scenes.view().instance_count; ++i) bits += own->has(i) ? 1 : 0;
      CHECK(bits == own->slots.size());
      for (const u32 slot : own->slots) CHECK(own->has(slot));
    }
}

TEST_CASE("static tree: of surfaces in the same place the lower instance's is met") {
  Own own;
  const auto scene = own(twins(48).apply());
  REQUIRE(group_of(*scene));
  const kernels::BvhView view = bvh::world_view(scene->placement());
  REQUIRE(view.top);
  const kernels::BvhTracer tracer(scene->view(), view);
  u32 first_is_fixed = 0;
  for (u32 i = 0; i < 48; ++i) {
    // Numbers of few bits: nothing is rounded, in whatever space.
    Ray ray{};
    ray.origin = place_of(i) + vec3(0.125f, 0.25f, 4);
    ray.direction = {0, 0, -1};
    ray.t_max = INFINITY;
    u32 lowest = kNone;
    for (u32 slot = 0; slot < scene->view().instance_count; ++slot) {
      const vec3 at = scene->view().instances[slot].world_from_object[3];
      if (at == place_of(i)) lowest = std::min(lowest, slot);
    }
    const Hit hit = tracer.closest(ray, kernels::kAllRays);
    CHECK(hit.instance == lowest);
    CHECK(hit.t == 3.5f);
    CHECK(hit.primitive == tracer.closest_in(lowest, ray).primitive);
    first_is_fixed += group_of(*scene)->has(lowest) ? 1 : 0;
  }
  CHECK((first_is_fixed > 10 && first_is_fixed < 38));
}

TEST_CASE("static tree: it is made anew when a member is, and only then") {
  Random random(2);
  Own own;
  SceneKinds kinds{.count = 60, .moving = false, .deforming = false, .fixed = true};
  const auto base = random_scene(random, kinds);
  const auto scene = own(base);
  const auto group = group_of(*scene);
  REQUIRE(group);
  const auto again = [&](const Edits& edits) {
    const auto changed = edits.apply(*base);
    const auto made = own(changed);
    CHECK(differing(*made, *Own()(changed)) == 0);
    return group_of(*made);
  };
  CHECK(again(Edits().pose("still 3", translation({0, 0, 1}))) == group);
  Light light;
  light.shape = LightShape::kSphere;
  light.intensity = 3;
  CHECK(again(Edits().light("lamp 3", light)) == group);
  // Others have other numbers: the same tree, and its members' numbers anew.
  const auto shifted = again(Edits().put("still 0", Remove{}));
  CHECK((shifted != group && shifted->tree == group->tree));
  CHECK(shifted->slots[0] == group->slots[0] - 1);
  CHECK(again(Edits().pose("still 1", translation({0, 0, 1})))->tree != group->tree);
  PutEntity hidden, loose;
  hidden.visibility = 1;
  loose.is_static = false;
  CHECK(again(Edits().put("still 1", hidden))->tree != group->tree);
  CHECK(again(Edits().put("still 1", loose))->tree != group->tree);
  CHECK(again(Edits().mesh("quad", cube()))->tree != group->tree);
  CHECK(group_of(*own(base))->tree == group->tree);
}

TEST_CASE("static tree: worlds share it") {
  Random random(4);
  Own own;
  const auto base = random_scene(random, {.count = 60, .moving = false, .fixed = true});
  std::vector<SceneAt> worlds;
  for (u32 i = 0; i < 20; ++i)
    worlds.push_back(
        {Edits().pose("still 0", translation({0, 0, float(i)})).apply(*base), TimeSpan{}});
  const auto made = own.store.prepare_all(worlds, Interrupt{});
  REQUIRE(made);
  for (const auto& world : *made) {
    const auto& scene = static_cast<const resident::ResidentScene&>(*world);
    CHECK(group_of(scene)->tree ==
          group_of(static_cast<const resident::ResidentScene&>(*made->front()))->tree);
  }
  CHECK(own.store.bytes() >
        group_of(static_cast<const resident::ResidentScene&>(*made->front()))->tree->bytes());
}

TEST_CASE("static tree: where there is nothing else there is no other tree") {
  Edits edits;
  edits.mesh("cube", cube());
  for (u32 i = 0; i < 40; ++i) {
    const std::string name = fmt::format("e{}", i);
    edits.object(name, "cube", translation({2 * float(i), 0, 0})).put(name, fixed());
  }
  Own own;
  const auto scene = own(edits.apply());
  const kernels::BvhView view = bvh::world_view(scene->placement());
  CHECK(view.top == nullptr);
  CHECK(view.fixed.nodes != nullptr);
  CHECK(differing(*scene, *Own()(edits.apply())) == 0);
  // As few as these are entered one by one.
  for (u32 i = 31; i < 40; ++i) edits.put(fmt::format("e{}", i), Remove{});
  CHECK(!group_of(*own(edits.apply())));
}

TEST_CASE("static tree: it is given up when nobody waits for it") {
  Random random(5);
  Own own;
  std::stop_source stop;
  stop.request_stop();
  const auto scene = random_scene(random, {.count = 2000, .moving = false, .fixed = true});
  const auto made = own.store.prepare(scene, {}, {.stop = stop.get_token(), .deadline = {}});
  REQUIRE(!made);
  CHECK(made.error().code == Code::kCancelled);
}

TEST_CASE("static tree: rays take fewer steps than through instances that overlap") {
  Random random(6);
  Edits edits;
  edits.mesh("ball", sphere(16)).mesh("cube", cube());
  for (u32 i = 0; i < 1000; ++i) {  // of W3's density
    const std::string name = fmt::format("e{}", i);
    edits.object(name, i % 5 ? "ball" : "cube", random_pose(random, 7.35f, 0.65f));
    edits.put(name, fixed());
  }
  Own own, apart(0);
  const auto base = edits.apply();
  const auto one = own(base), many = apart(base);
  const kernels::BvhView one_view = bvh::world_view(one->placement()),
                         many_view = bvh::world_view(many->placement());
  REQUIRE((!one_view.top && !many_view.fixed.nodes));
  constexpr u32 kRays = 20'000;
  u64 steps = 0, steps_apart = 0;
  for (u32 i = 0; i < kRays; ++i) {
    Ray ray = random_ray(random, 7);
    ray.t_max = INFINITY;
    steps += steps_of(one->view(), one_view, ray);
    steps_apart += steps_of(many->view(), many_view, ray);
  }
  INFO("steps a ray: " << double(steps) / kRays << ", apart " << double(steps_apart) / kRays);
  CHECK(steps * 3 < steps_apart * 2);
}

TEST_CASE("static tree: Embree's bounds follow a member that moves, whatever came before") {
  const embree::DeviceHandle device(rtcNewDevice(nullptr));
  const embree::EmbreeAccelerator accelerator(device.get(), kMost);
  resident::DerivedCache cache(1u << 30), other_cache(1u << 30);
  resident::SceneStore store(accelerator, cache, 1u << 30);
  resident::SceneStore fresh(accelerator, other_cache, 1u << 30);
  const auto scene = twins(48).apply();
  const auto before = store.prepare(scene, {0, 0}, Interrupt{});
  REQUIRE(before);
  Edits away;
  scene->entities.for_each([&](u32, const Entity& entity) {
    if (entity.is_static) away.pose(*entity.name, translation({0, 0, 400}));
  });
  const auto moved = away.apply(*scene);
  const auto after = store.prepare(moved, {0, 0}, Interrupt{});
  const auto alone = fresh.prepare(moved, {0, 0}, Interrupt{});
  REQUIRE((after && alone));
  CHECK((*after)->placement().bounds.upper.z > 400);
  CHECK((*after)->placement().bounds.upper == (*alone)->placement().bounds.upper);
}
