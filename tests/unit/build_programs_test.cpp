// The GPU's programs that make instances and build trees, run on the host: what TreeBuilder has
// them make is what the steps of kernels/bvh_build.h make one after the other.
#include <map>
#include <string>

#include "renderer/backend/cuda/build.h"
#include "renderer/backend/cuda/place.h"
#include "renderer/backend/cuda/programs.h"
#include "tests/unit/bvh_loops.h"
#include "tests/unit/catch.h"
#include "tests/unit/fake_driver.h"
#include "tests/unit/gpu_fibers.h"
#include "tests/unit/random.h"

#include "renderer/backend/cuda/build.cu"
#include "renderer/backend/cuda/place.cu"
#include "renderer/backend/cuda/sort.cu"

using namespace heliograph;
using namespace heliograph::test;

std::span<const std::byte* const> heliograph::cuda::programs() {
  static const std::byte any{};
  static const std::byte* const all[] = {&any};
  return all;
}

namespace {

using Run = std::function<void(void** arguments)>;
u32 launches = 0;

template <class T>
Run program(void (*f)(T)) {
  return [f](void** arguments) { f(*static_cast<T*>(arguments[0])); };
}
Run program(void (*f)(BuildLaunch, u32)) {
  return [f](void** arguments) {
    f(*static_cast<BuildLaunch*>(arguments[0]), *static_cast<u32*>(arguments[1]));
  };
}

const std::map<std::string, Run, std::less<>>& all_programs() {
  static const std::map<std::string, Run, std::less<>> all{
#define HELIO_PROGRAM(name) {#name, program(name)}
      HELIO_PROGRAM(build_boxes),    HELIO_PROGRAM(build_triangle_boxes),
      HELIO_PROGRAM(build_keys),     HELIO_PROGRAM(build_leaves),
      HELIO_PROGRAM(build_clusters), HELIO_PROGRAM(build_nodes),
      HELIO_PROGRAM(build_items),    HELIO_PROGRAM(build_triangles),
      HELIO_PROGRAM(sort_pass),      HELIO_PROGRAM(sort_few),
      HELIO_PROGRAM(refit_items),    HELIO_PROGRAM(refit_nodes),
      HELIO_PROGRAM(place_instances)};
#undef HELIO_PROGRAM
  return all;
}

/// A driver whose programs are those above.
cuda::Driver running_driver() {
  cuda::Driver d = fake_driver();
  d.function_in = [](cuda::FunctionHandle* out, cuda::ModuleHandle, const char* name) {
    const auto found = all_programs().find(name);
    if (found == all_programs().end()) return 500;
    *out = reinterpret_cast<cuda::FunctionHandle>(const_cast<Run*>(&found->second));
    return 0;
  };
  d.blocks_per_processor = [](int* blocks, cuda::FunctionHandle, int, std::size_t) {
    return *blocks = 2, 0;
  };
  d.launch = [](cuda::FunctionHandle f, unsigned blocks, unsigned, unsigned, unsigned threads,
                unsigned, unsigned, unsigned, cuda::StreamHandle, void** arguments, void**) {
    ++launches;
    run_on_fibers(blocks, threads, [&] { (*reinterpret_cast<const Run*>(f))(arguments); });
    return 0;
  };
  return d;
}

struct Gpu {
  cuda::Driver driver = running_driver();
  std::shared_ptr<cuda::Context> context = cuda::Context::create(driver, 0).value();
  cuda::TreeBuilder builder = cuda::TreeBuilder::create(context).value();
  cuda::InstancePlacer placer = cuda::InstancePlacer::create(context).value();
};

/// Triangles of all sizes without an order; some twice, and some with no corner that is a number.
struct Soup {
  Soup(u32 count, float place, float size) {
    Random random(count);
    const auto within = [&](float reach) {
      const vec2 xy = random.next2();
      return (2.0f * vec3(xy, random.next()) - 1.0f) * reach;
    };
    for (u32 i = 0; i < count; ++i) {
      const bool again = i > 0 && i % 7 == 0;
      const vec3 at = again ? positions[3 * i - 3] : within(place);
      for (u32 k = 0; k < 3; ++k) positions.push_back(i % 11 == 5 ? vec3(NAN) : at + within(size));
      triangles.emplace_back(3 * i, 3 * i + 1, 3 * i + 2);
    }
    view.triangles = triangles.data();
    view.positions = positions.data();
    view.triangle_count = count;
    view.vertex_count = 3 * count;
  }
  std::vector<vec3> positions;
  std::vector<uvec3> triangles;
  kernels::MeshView view{};
};

LoopBuild steps_over(const kernels::MeshView& mesh, std::vector<BvhBox>& boxes) {
  for (u32 i = 0; i < mesh.triangle_count; ++i) boxes.push_back(kernels::triangle_box(mesh, i));
  return {boxes, 0.3f, LoopOrder::kForwards};
}

}  // namespace

TEST_CASE("build programs: trees over triangles are those of the steps") {
  Gpu gpu;
  for (const u32 count : {1u, 2u, 3u, 40u, 700u, 2048u, 2049u, 9000u}) {
    INFO(count << " triangles");
    const Soup soup(count, 10, count % 2 ? 0.1f : 3);
    std::vector<BvhBox> boxes;
    const LoopBuild steps = steps_over(soup.view, boxes);
    launches = 0;
    const auto tree = gpu.builder.build(soup.view);
    REQUIRE(tree);
    CHECK(launches == (count <= 2048 ? 6u : 15u));
    const kernels::MeshBvh made = cuda::view_of_mesh(**tree, soup.view);
    REQUIRE(std::memcmp(made.nodes, steps.nodes().data(),
                        steps.nodes().size() * sizeof(kernels::BvhNode)) == 0);
    for (u32 i = 0; i < count; ++i) REQUIRE(made.triangles[i].number == steps.items()[i]);
  }
}

TEST_CASE("build programs: trees over instances are those of the steps, balanced ones too") {
  Gpu gpu;
  const std::vector<kernels::MeshBvh> meshes(1);
  const std::vector<BvhBox> mesh_boxes{{vec3(-1), vec3(1)}};
  for (const u32 count : {600u, 3000u}) {  // one within the other: so many are too deep
    std::vector<kernels::InstanceView> instances(count);
    std::vector<BvhBox> boxes;
    for (u32 i = 0; i < count; ++i) {
      instances[i].world_from_object = mat4x3(float(i + 1));
      instances[i].visibility = i % 50 == 49 ? 0 : 1;
      boxes.push_back(kernels::ray_box(instances[i], nullptr, mesh_boxes[0]));
    }
    const LoopBuild steps(boxes, 2, LoopOrder::kBackwards);
    CHECK(steps.head().balances == (count == 3000));
    const cuda::BuildInput input{instances.data(), nullptr, meshes.data(), count, mesh_boxes};
    const auto top = gpu.builder.build(input);
    REQUIRE(top);
    const kernels::BvhView made = cuda::view_of_top(**top, input);
    REQUIRE(std::memcmp(made.top, steps.nodes().data(),
                        steps.nodes().size() * sizeof(kernels::BvhNode)) == 0);
    for (u32 i = 0; i < count; ++i) {
      REQUIRE(made.items[i].instance == steps.items()[i]);
      REQUIRE(made.item_of_instance[steps.items()[i]] == i);
    }
  }
}

TEST_CASE("build programs: instances that are left out are items, and not in the tree") {
  Gpu gpu;
  const std::vector<kernels::MeshBvh> meshes(1);
  const std::vector<BvhBox> mesh_boxes{{vec3(-1), vec3(1)}};
  constexpr u32 kCount = 700;
  std::vector<kernels::InstanceView> instances(kCount);
  for (u32 i = 0; i < kCount; ++i) {
    instances[i].world_from_object = mat4x3(1);
    instances[i].world_from_object[3] = vec3(float(i % 20), float(i % 30), float(i % 7));
    instances[i].visibility = 1;
  }
  for (const u32 stays : {3u, 699u, kCount}) {  // one of so many, but for the first
    std::vector<BvhBox> boxes;
    std::vector<u32> bits((kCount + 31) / 32);
    cuda::BuildInput input{instances.data(), nullptr, meshes.data(), kCount, mesh_boxes};
    for (u32 i = 0; i < kCount; ++i) {
      const bool is_out = i == 0 || i % stays != 0;
      boxes.push_back(is_out ? kernels::no_box()
                             : kernels::ray_box(instances[i], nullptr, mesh_boxes[0]));
      bits[i / 32] |= is_out ? 1u << (i % 32) : 0u;
      input.left_out_count += is_out ? 1 : 0;
    }
    input.left_out = bits.data();
    const LoopBuild steps(boxes, 2, LoopOrder::kForwards);
    launches = 0;
    const auto top = gpu.builder.build(input);
    REQUIRE(top);
    const kernels::BvhView made = cuda::view_of_top(**top, input);
    REQUIRE((made.top != nullptr) == input.has_tree());
    CHECK(input.has_tree() == (stays < kCount));
    if (!input.has_tree()) CHECK(launches == 1);
    if (input.has_tree())
      REQUIRE(std::memcmp(made.top, steps.nodes().data(),
                          steps.nodes().size() * sizeof(kernels::BvhNode)) == 0);
    for (u32 i = 0; i < kCount; ++i) {
      const u32 instance = input.has_tree() ? steps.items()[i] : i;
      REQUIRE(made.items[i].instance == instance);
      REQUIRE(made.item_of_instance[instance] == i);
    }
  }
}

namespace {

/// Unit balls on a grid, and what trees over them are built and refitted with.
struct Grid {
  explicit Grid(u32 count) : instances(count) {
    for (u32 i = 0; i < count; ++i) {
      instances[i].world_from_object = mat4x3(1);
      instances[i].world_from_object[3] = 4.0f * vec3(i % 9, i / 9 % 9, float(i) / 81);
      instances[i].visibility = i % 50 == 49 ? 0 : 1;
    }
  }
  [[nodiscard]] cuda::BuildInput input(const cuda::DeviceMemory* before = nullptr) const {
    return {.instances = instances.data(),
            .motion_keys = nullptr,
            .meshes = meshes.data(),
            .count = u32(instances.size()),
            .mesh_boxes = mesh_boxes,
            .before = before};
  }
  [[nodiscard]] std::vector<BvhBox> boxes() const {
    std::vector<BvhBox> all;
    for (const auto& instance : instances)
      all.push_back(kernels::ray_box(instance, nullptr, mesh_boxes[0]));
    return all;
  }
  std::vector<kernels::InstanceView> instances;
  std::vector<kernels::MeshBvh> meshes{1};
  std::vector<BvhBox> mesh_boxes{{vec3(-1), vec3(1)}};
};

bool has_nodes_of(const kernels::BvhView& top, const std::vector<kernels::BvhNode>& nodes) {
  return std::memcmp(top.top, nodes.data(), nodes.size() * sizeof(kernels::BvhNode)) == 0;
}

/// Which instances a ray through everything meets the boxes of.
std::vector<u32> met_by(const kernels::BvhView& top, vec3 origin, vec3 direction) {
  std::vector<u32> nodes{0}, met;
  const kernels::BoxRay ray = kernels::box_ray(origin, direction);
  while (!nodes.empty()) {
    const u32 number = nodes.back();
    nodes.pop_back();
    kernels::NodeChildren children = kernels::meet_children(top.top + number, ray, INFINITY);
    while (kernels::has_nodes(children.nodes))
      nodes.push_back(kernels::take_node(children.nodes, ray.octant));
    for (u32 bit = 0; bit < 24; ++bit)
      if (children.items.bits >> bit & 1)
        met.push_back(top.items[children.items.base + bit].instance);
  }
  std::ranges::sort(met);
  return met;
}

bool meets(const BvhBox& box, vec3 origin, vec3 direction) {
  const vec3 a = (box.lower - origin) / direction, b = (box.upper - origin) / direction;
  const vec3 near = glm::min(a, b), far = glm::max(a, b);
  return std::max({near.x, near.y, near.z, 0.0f}) <= std::min({far.x, far.y, far.z});
}

}  // namespace

TEST_CASE("build programs: what nothing moved in is refitted to the same tree") {
  Gpu gpu;
  for (const u32 count : {600u, 3000u}) {
    const Grid grid(count);
    const auto built = gpu.builder.build(grid.input());
    REQUIRE(built);
    launches = 0;
    const auto again = gpu.builder.build(grid.input(built->get()));
    REQUIRE(again);
    CHECK(launches == (count <= 2048 ? 8u : 17u));
    const LoopBuild steps(grid.boxes(), 2, LoopOrder::kForwards);
    const auto top = cuda::view_of_top(**again, grid.input());
    CHECK(has_nodes_of(top, steps.nodes()));
    for (u32 i = 0; i < count; ++i) CHECK(top.items[i].instance == steps.items()[i]);
  }
}

TEST_CASE("build programs: a refitted tree is over all that it was over, where it is now") {
  Gpu gpu;
  Random random(3);
  Grid grid(1200);
  auto tree = *gpu.builder.build(grid.input());
  const auto built = cuda::view_of_top(*tree, grid.input());
  for (u32 round = 0; round < 5; ++round) {  // each from the one before
    for (auto& instance : grid.instances)
      instance.world_from_object[3] += 0.1f * (vec3(random.next2(), random.next()) - 0.5f);
    tree = *gpu.builder.build(grid.input(tree.get()));
  }
  const auto top = cuda::view_of_top(*tree, grid.input());
  for (u32 i = 0; i < grid.instances.size(); ++i) {
    CHECK(top.items[i].instance == built.items[i].instance);
    CHECK(top.item_of_instance[top.items[i].instance] == i);
    const auto item = kernels::bvh_instance(grid.instances[top.items[i].instance], 0, {});
    CHECK(std::ranges::equal(top.items[i].object_from_world, item.object_from_world));
  }
  CHECK_FALSE(has_nodes_of(top, LoopBuild(grid.boxes(), 2, LoopOrder::kForwards).nodes()));
  const std::vector<BvhBox> boxes = grid.boxes();
  for (u32 i = 0; i < 300; ++i) {
    const vec3 origin = 40.0f * vec3(random.next2(), random.next()) - 4.0f;
    const vec3 direction = glm::normalize(vec3(random.next2(), random.next()) - 0.5f);
    const std::vector<u32> met = met_by(top, origin, direction);
    for (u32 k = 0; k < boxes.size(); ++k)
      if (!boxes[k].empty() && meets(boxes[k], origin, direction))
        REQUIRE(std::ranges::binary_search(met, k));
  }
}

TEST_CASE("build programs: a tree that would be bad, or over others, is built anew") {
  Gpu gpu;
  Random random(5);
  const Grid before(1200);
  const auto tree = *gpu.builder.build(before.input());
  Grid scattered = before, seen = before, hidden = before;
  for (auto& instance : scattered.instances)
    instance.world_from_object[3] = 40.0f * vec3(random.next2(), random.next());
  seen.instances[49].visibility = 1;
  hidden.instances[48].visibility = 0;
  for (const Grid& now : {scattered, seen, hidden}) {
    const auto made = *gpu.builder.build(now.input(tree.get()));
    const LoopBuild steps(now.boxes(), 2, LoopOrder::kForwards);
    const auto top = cuda::view_of_top(*made, now.input());
    CHECK(has_nodes_of(top, steps.nodes()));
    for (u32 i = 0; i < now.instances.size(); ++i) CHECK(top.items[i].instance == steps.items()[i]);
  }
}

TEST_CASE("build programs: instances are in their places, and hidden where they have none") {
  constexpr u32 kMask = 7, kCount = 300;
  // By number: at rest, mirrored, flat, not a number, beyond what rays reach, moving, moving and
  // flat.
  constexpr u32 kKinds = 7;
  Random random(5);
  kernels::MotionKey key{};
  key.rotation = {0, 0, 0, 1};
  key.xx = key.yy = key.zz = 2;
  kernels::MotionKey flat = key;
  flat.yy = 0;
  const std::vector<kernels::MotionKey> keys{key, key, flat, key};
  std::vector<kernels::SlotView> slots(kCount);
  std::vector<mat4x3> world(2 * kCount);
  for (u32 i = 0; i < kCount; ++i) {
    const u32 kind = i % kKinds;
    const vec2 at = random.next2();
    mat4x3& m = world[2 * i] = mat4x3(2);
    m[3] = {at.x, at.y, random.next()};
    if (kind == 1) m[0] = -m[0];
    if (kind == 2) m[1] = vec3(0);
    if (kind == 3) m[3].y = NAN;
    if (kind == 4) m[2] *= 1e-12f;
    slots[i] = {.mesh = i, .flags = kernels::kCatcher, .visibility = kMask, .entity = 2 * i};
    slots[i].scale = vec3(1, 3, 1);
    if (kind >= 5) slots[i].segments = 1, slots[i].first_key = 2 * (kind - 5);
  }
  std::vector<kernels::InstanceView> made(kCount);
  const Gpu gpu;
  REQUIRE(gpu.placer.place({slots.data(), world.data(), keys.data(), made.data(), kCount}));
  for (u32 i = 0; i < kCount; ++i) {
    const u32 kind = i % kKinds;
    const kernels::InstanceView& instance = made[i];
    CAPTURE(i, kind);
    CHECK((instance.mesh == i && instance.entity == 2 * i));
    const bool has_pose = kind != 2 && kind != 3 && kind != 6;
    CHECK(instance.visibility == (has_pose && kind != 4 ? kMask : 0));
    CHECK(instance.flags == (kernels::kCatcher | (kind == 1 ? u32(kernels::kFlipped) : 0u)));
    const mat4x3 pose = has_pose ? world[2 * i] : mat4x3(1);
    const vec3 p(1, 2, 3), scale = has_pose ? slots[i].scale : vec3(1);
    CHECK(instance.world_from_object * vec4(p, 1) == pose * vec4(p * scale, 1));
    const vec3 back = instance.object_from_world * vec4(instance.world_from_object * vec4(p, 1), 1);
    CHECK(glm::length(back - p) < (kind == 4 ? 1e6f : 1e-5f));
  }
}
