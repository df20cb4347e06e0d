// The tree that a GPU makes, made step by step: what it holds, that the order of the steps does not
// change it, that rays find in it what they find in the host's tree, and how many nodes they visit.
#include <functional>

#include "kernels/bvh/bvh_tracer.h"
#include "renderer/backend/embree/top_level.h"
#include "renderer/bvh/build.h"
#include "tests/unit/bvh_loops.h"
#include "tests/unit/bvh_scene.h"
#include "tests/unit/bvh_walker.h"

using namespace heliograph;
using namespace heliograph::test;
using bvh::Tree;
using kernels::BvhBox;
using kernels::Hit;
using kernels::Ray;

namespace {

constexpr float kItemCost = 2;

std::vector<BvhBox> kernel_boxes(std::span<const Box> boxes) {
  std::vector<BvhBox> out;
  for (const Box& box : boxes) out.push_back({box.lower, box.upper});
  return out;
}

LoopBuild build(std::span<const BvhBox> boxes, LoopOrder order = {}) {
  return {boxes, kItemCost, order};
}

/// What a build leaves on a device: items of empty boxes come last.
Tree tree_of(const LoopBuild& made) {
  Tree tree{made.nodes(), made.items()};
  tree.items.resize(made.head().count);
  return tree;
}

void check_sound(std::span<const Box> boxes) {
  const auto kernel = kernel_boxes(boxes);
  const LoopBuild made = build(kernel);
  test::check_sound(tree_of(made), boxes);
  std::vector<u32> found(boxes.size());
  for (const u32 item : made.items()) ++found.at(item);
  CHECK(std::ranges::count(found, 1u) == i64(boxes.size()));
}

/// Instances as rays enter them, in the order of a build.
struct BuiltTop {
  BuiltTop(const kernels::SceneView& scene, const kernels::MeshBvh* meshes,
           std::span<const BvhBox> mesh_boxes) {
    std::vector<BvhBox> boxes;
    for (u32 i = 0; i < scene.instance_count; ++i)
      boxes.push_back(kernels::ray_box(scene.instances[i], scene.motion_keys,
                                       mesh_boxes[scene.instances[i].mesh]));
    const LoopBuild made = build(boxes);
    nodes = made.nodes();
    item_of_instance.resize(boxes.size());
    for (const u32 instance : made.items()) {
      const kernels::InstanceView& seen = scene.instances[instance];
      item_of_instance[instance] = u32(items.size());
      items.push_back(kernels::bvh_instance(seen, instance, meshes[seen.mesh]));
    }
    view = {nodes.data(), items.data(), meshes, item_of_instance.data(), u32(items.size()), {}};
  }
  std::vector<kernels::BvhNode> nodes;
  std::vector<kernels::BvhInstance> items;
  std::vector<u32> item_of_instance;
  kernels::BvhView view;
};

/// The tree of the steps over a mesh.
struct BuiltMesh {
  explicit BuiltMesh(const kernels::MeshView& mesh) {
    std::vector<BvhBox> boxes;
    for (u32 i = 0; i < mesh.triangle_count; ++i) boxes.push_back(kernels::primitive_box(mesh, i));
    const LoopBuild made(boxes, 0.3f, {});
    nodes = made.nodes();
    numbers = made.items();
    const bool packed = kernels::has_packed_triangles(mesh);
    for (const u32 i : numbers)
      if (packed) triangles.push_back(kernels::bvh_triangle(mesh, i));
    view = {nodes.data(), packed ? triangles.data() : nullptr, numbers.data()};
  }
  std::vector<kernels::BvhNode> nodes;
  std::vector<kernels::BvhTriangle> triangles;
  std::vector<u32> numbers;
  kernels::MeshBvh view{};
};

/// Balls without triangles, so that all nodes are of the top level.
struct Balls {
  Balls(u32 count, const std::function<void(u32, vec3& at, vec3& size)>& place) {
    kernels::MeshView mesh{};
    mesh.shape = kernels::Shape::kSphere;
    meshes.push_back(mesh);
    instances.resize(count);
    std::vector<Box> boxes(count);
    for (u32 i = 0; i < count; ++i) {
      vec3 at, size;
      place(i, at, size);
      instances[i] = {};
      instances[i].world_from_object =
          mat4x3(size.x, 0, 0, 0, size.y, 0, 0, 0, size.z, at.x, at.y, at.z);
      instances[i].object_from_world = kernels::inverse_of(instances[i].world_from_object);
      instances[i].visibility = kernels::kAllRays;
      boxes[i] = {at - size * 1.000001f, at + size * 1.000001f};
    }
    scene.instances = instances.data();
    scene.instance_count = count;
    scene.meshes = meshes.data();
    auto tree = bvh::build_tree(boxes, {.item_cost = kItemCost}, {});
    REQUIRE(tree);
    nodes = std::move(tree->nodes);
    items.reserve(count);
    item_of_instance.resize(count);
    for (const u32 i : tree->items) {
      item_of_instance[i] = u32(items.size());
      items.push_back(kernels::bvh_instance(instances[i], i, mesh_bvh));
    }
    view = {nodes.data(), items.data(), &mesh_bvh, item_of_instance.data(), count, {}};
  }
  std::vector<kernels::MeshView> meshes;
  std::vector<kernels::InstanceView> instances;
  std::vector<kernels::BvhNode> nodes;
  std::vector<kernels::BvhInstance> items;
  std::vector<u32> item_of_instance;
  kernels::SceneView scene{};
  kernels::MeshBvh mesh_bvh{};
  kernels::BvhView view{};
};

/// How many times as many steps rays take through the tree of the steps as through the host's.
double relative_steps(const Balls& balls, float reach) {
  const BvhBox unit{vec3(-1), vec3(1)};
  const BuiltTop built(balls.scene, &balls.mesh_bvh, {&unit, 1});
  Random random(11);
  u64 host = 0, own = 0;
  for (u32 i = 0; i < 20'000; ++i) {
    Ray ray = random_ray(random, reach);
    ray.t_max = INFINITY;
    host += steps_of(balls.scene, balls.view, ray);
    own += steps_of(balls.scene, built.view, ray);
  }
  UNSCOPED_INFO("steps a ray: " << double(host) / 20'000 << " host, " << double(own) / 20'000);
  return double(own) / double(host);
}

}  // namespace

TEST_CASE("bvh steps: every item is in its boxes, once") {
  Random random(1);
  for (const u32 count : {1u, 2u, 3u, 4u, 5u, 8u, 9u, 16u, 17u, 18u, 33u, 64u, 1000u, 20000u}) {
    INFO(count << " boxes");
    check_sound(random_boxes(random, count, 10, 1));
    check_sound(random_boxes(random, count, 1, 100));
  }
  std::vector<Box> boxes = random_boxes(random, 100, 1, 0.1f);
  for (u32 i = 0; i < 100; i += 3) boxes[i] = {};
  check_sound(boxes);
  const std::vector<Box> none(3);
  check_sound(none);
  const LoopBuild made = build(kernel_boxes(none));
  REQUIRE(made.nodes().size() == 1);
  CHECK((made.head().count == 0 && made.nodes()[0].inner == 0 && made.nodes()[0].meta[0] == 0));
}

TEST_CASE("bvh steps: coincident, flat, huge and tiny boxes") {
  Random random(2);
  check_sound(std::vector<Box>(5000, Box{vec3(1), vec3(2)}));
  check_sound(std::vector<Box>(5000, Box{vec3(3), vec3(3)}));
  for (const float size : {1e-38f, 1e-20f, 1e20f, 1e37f})
    check_sound(random_boxes(random, 500, size, size));
  check_sound(random_boxes(random, 500, 1e6f, 1e-3f));
  std::vector<Box> boxes = random_boxes(random, 500, 1, 1);
  boxes.push_back({vec3(-FLT_MAX), vec3(FLT_MAX)});
  boxes.push_back({vec3(-FLT_MAX), vec3(-FLT_MAX)});
  check_sound(boxes);
  for (Box& box : boxes) box.lower.z = box.upper.z = 7;
  check_sound(boxes);
}

TEST_CASE("bvh steps: a tree too deep for rays' stacks gives way to a balanced one") {
  std::vector<Box> boxes;  // each within the next
  for (u32 i = 1; i <= 100'000; ++i) boxes.push_back({vec3(-float(i)), vec3(float(i))});
  const auto kernel = kernel_boxes(boxes);
  CHECK(build(kernel).head().balances == 1);
  check_sound(boxes);
  CHECK(build(kernel_boxes(std::vector<Box>(100'000, Box{vec3(1), vec3(2)}))).head().balances == 0);
}

TEST_CASE("bvh steps: the same bytes in whatever order the steps come") {
  Random random(3);
  const auto boxes = kernel_boxes(random_boxes(random, 3000, 10, 1));
  const Tree one = tree_of(build(boxes));
  for (const LoopOrder order : {LoopOrder::kBackwards, LoopOrder::kShuffled})
    CHECK(same_trees(one, tree_of(build(boxes, order))));
}

TEST_CASE("bvh steps: rays meet what they meet with the host's tree") {
  Random random(4);
  SceneKinds kinds;
  TimeSpan span{0, 1};
  SECTION("of all kinds") {}
  SECTION("of many that stand still") {
    kinds = {.count = 2000, .moving = false, .deforming = false, .shapes = false, .holes = false};
    span = {};
  }
  SECTION("of what moves") { kinds = {.count = 200, .shapes = false, .masks = false}; }
  SECTION("of curves") { kinds = {.count = 50, .curves = true}; }
  const BothScenes scenes(random_scene(random, kinds), span);
  std::vector<BvhBox> mesh_boxes;
  for (const auto& mesh : scenes.own().placement().meshes) {
    const Box box = mesh->accelerator->bounds();
    mesh_boxes.push_back({box.lower, box.upper});
  }
  const BuiltTop built(scenes.view(), scenes.bvh_view().meshes, mesh_boxes);
  const kernels::BvhTracer host = scenes.bvh(), own(scenes.view(), built.view);
  u32 met = 0, differ = 0;
  constexpr u32 kRays = 100'000;
  for (u32 i = 0; i < kRays; ++i) {
    const Ray ray = random_ray(random, 12);
    const u32 mask = i % 2 ? u32(kernels::kAllRays) : 1u << (i / 2 % 6);
    const Hit a = host.closest(ray, mask), b = own.closest(ray, mask);
    met += a.instance != kNone;
    differ += a.t != b.t || a.instance != b.instance || a.primitive != b.primitive || a.u != b.u ||
              a.v != b.v;
    differ += host.occluded(ray, mask) != own.occluded(ray, mask);
    const u32 instance = i % scenes.view().instance_count;
    differ += host.closest_in(instance, ray).t != own.closest_in(instance, ray).t;
  }
  CHECK((met > kRays / 20 && met < kRays));
  CHECK(differ == 0);
}

TEST_CASE("bvh steps: rays meet what they meet with the host's trees of meshes") {
  Random random(6);
  for (const TimeSpan span : {TimeSpan{0, 1}, TimeSpan{0.7, 0.7}}) {
    const BothScenes scenes(random_scene(random, {.count = 30, .shapes = false, .curves = true}),
                            span);
    const kernels::SceneView& scene = scenes.view();
    std::vector<BuiltMesh> built;
    for (const auto& mesh : scenes.own().placement().meshes) built.emplace_back(mesh->view());
    std::vector<kernels::MeshBvh> meshes;
    for (const BuiltMesh& mesh : built) meshes.push_back(mesh.view);
    kernels::BvhView view = scenes.bvh_view();
    std::vector<kernels::BvhInstance> items(view.items, view.items + view.instance_count);
    for (kernels::BvhInstance& item : items)
      item =
          kernels::bvh_instance(scene.instances[item.instance], item.instance, meshes[item.mesh]);
    view.items = items.data();
    view.meshes = meshes.data();
    const kernels::BvhTracer host = scenes.bvh(), own(scene, view);
    u32 met = 0, differ = 0;
    for (u32 i = 0; i < 100'000; ++i) {
      const Ray ray = random_ray(random, 12);
      const Hit a = host.closest(ray, kernels::kAllRays), b = own.closest(ray, kernels::kAllRays);
      met += a.instance != kNone;
      differ += a.t != b.t || a.instance != b.instance || a.primitive != b.primitive ||
                a.u != b.u || a.v != b.v;
    }
    CHECK(met > 5000);
    CHECK(differ == 0);
  }
}

TEST_CASE("bvh steps: rays visit few more nodes than in the host's tree") {
  Random random(5);
  for (const u32 count : {1000u, 100'000u}) {
    const float side = std::cbrt(float(count)), half = side / 2;
    INFO(count << " balls");
    SECTION(fmt::format("{} on a grid", count)) {
      const Balls balls(count, [&](u32 i, vec3& at, vec3& size) {
        const u32 s = u32(std::ceil(side));
        const uvec3 cell(i % s, i / s % s, i / (s * s));
        at = vec3(cell) - half;
        size = vec3(0.35f);
      });
      CHECK(relative_steps(balls, half) < 1.3);
    }
    SECTION(fmt::format("{} of all sizes", count)) {
      const Balls balls(count, [&](u32, vec3& at, vec3& size) {
        at = random_vec3(random, half);
        size = vec3(0.05f / (0.03f + random.next()));
      });
      CHECK(relative_steps(balls, half) < 1.3);
    }
    SECTION(fmt::format("{} on the ground, with the ground", count)) {
      const float reach = std::sqrt(float(count));
      const Balls balls(count, [&](u32 i, vec3& at, vec3& size) {
        at = random_vec3(random, reach) * vec3(1, 1, 0);
        size = vec3(0.3f, 0.3f, 0.1f + 2 * random.next());
        if (i == 0) at = vec3(0), size = vec3(reach, reach, 0.01f);
      });
      CHECK(relative_steps(balls, reach) < 1.3);
    }
    SECTION(fmt::format("{} in heaps", count)) {
      vec3 heap;
      const Balls balls(count, [&](u32 i, vec3& at, vec3& size) {
        if (i % 100 == 0) heap = random_vec3(random, half);
        at = heap + random_vec3(random, 1) * random.next();
        size = random_vec3(random, 0.1f) + 0.11f;
      });
      CHECK(relative_steps(balls, half) < 1.3);
    }
  }
}
