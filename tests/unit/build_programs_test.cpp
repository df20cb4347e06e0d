// The GPU's programs that make instances and build trees, run on the host: what TreeBuilder has
// them make is what the steps of kernels/bvh/bvh_build.h make one after the other.
#include <map>
#include <string>

#include "renderer/backend/cuda/build.h"
#include "renderer/backend/cuda/programs.h"
#include "tests/unit/bvh_loops.h"
#include "tests/unit/catch.h"
#include "tests/unit/fake_driver.h"
#include "tests/unit/gpu_fibers.h"
#include "tests/unit/random.h"

#include "renderer/backend/cuda/build.cu"
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

Run program(void (*f)(BuildLaunch)) {
  return [f](void** arguments) { f(*static_cast<BuildLaunch*>(arguments[0])); };
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
      HELIO_PROGRAM(refit_triangles)};
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
  for (u32 i = 0; i < mesh.triangle_count; ++i) boxes.push_back(kernels::primitive_box(mesh, i));
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

/// What a ray through everything meets the boxes of: number_of(an item's place), ascending.
template <class F>
std::vector<u32> met_by(const kernels::BvhNode* tree, const F& number_of, vec3 origin,
                        vec3 direction) {
  std::vector<u32> nodes{0}, met;
  const kernels::BoxRay ray = kernels::box_ray(origin, direction);
  while (!nodes.empty()) {
    const u32 number = nodes.back();
    nodes.pop_back();
    kernels::NodeChildren children = kernels::meet_children(tree + number, ray, INFINITY);
    while (kernels::has_nodes(children.nodes))
      nodes.push_back(kernels::take_node(children.nodes, ray.octant));
    for (u32 bit = 0; bit < 24; ++bit)
      if (children.items.bits >> bit & 1) met.push_back(number_of(children.items.base + bit));
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
    const auto instance_at = [&](u32 item) { return top.items[item].instance; };
    const std::vector<u32> met = met_by(top.top, instance_at, origin, direction);
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

TEST_CASE("build programs: a mesh's tree is refitted where it bends a little, or else built anew") {
  Gpu gpu;
  Random random(11);
  for (const u32 segments : {0u, 1u}) {
    CAPTURE(segments);
    Soup soup(1500, 10, 0.3f);
    const std::vector<vec3> rest = soup.positions;
    const auto pose = [&](const auto& moved) {  // of all keys
      for (u32 i = 0; i < rest.size(); ++i)
        for (u32 key = 0; key <= segments; ++key)
          soup.positions[key * rest.size() + i] = moved(rest[i], key);
      soup.view.positions = soup.positions.data();
    };
    soup.positions.resize((segments + 1) * rest.size());
    soup.view.segments = segments;
    const auto built_at_once = [&] {
      std::vector<BvhBox> boxes;
      return steps_over(soup.view, boxes).nodes();
    };
    const auto has_nodes = [&](const kernels::MeshBvh& made, const auto& nodes) {
      return std::memcmp(made.nodes, nodes.data(), nodes.size() * sizeof(nodes[0])) == 0;
    };
    const auto numbers = [&](const kernels::MeshBvh& made) {
      std::vector<u32> all;
      for (u32 i = 0; i < soup.view.triangle_count; ++i)
        all.push_back(made.triangles ? made.triangles[i].number : made.triangle_numbers[i]);
      return all;
    };
    pose([](vec3 p, u32) { return p; });
    const auto first = *gpu.builder.build(soup.view);
    const auto before = cuda::view_of_mesh(*first, soup.view);
    const auto same = *gpu.builder.build(soup.view, {first.get(), soup.view});
    CHECK(has_nodes(cuda::view_of_mesh(*same, soup.view), built_at_once()));

    pose([&](vec3 p, u32 key) { return p + 0.05f * float(key) + 0.1f * glm::sin(p * 0.3f); });
    const auto bent = *gpu.builder.build(soup.view, {first.get(), soup.view});
    const auto made = cuda::view_of_mesh(*bent, soup.view);
    CHECK(numbers(made) == numbers(before));
    CHECK_FALSE(has_nodes(made, built_at_once()));
    const std::vector<u32> order = numbers(made);
    const auto triangle_at = [&](u32 item) { return order[item]; };
    if (made.triangles)
      for (u32 i = 0; i < order.size(); ++i)
        if (const auto now = kernels::bvh_triangle(soup.view, order[i]); now.a == now.a)
          REQUIRE((made.triangles[i].a == now.a && made.triangles[i].c == now.c));
    for (u32 i = 0; i < soup.view.triangle_count; i += 13) {
      const BvhBox box = kernels::primitive_box(soup.view, i);
      if (box.empty()) continue;
      const vec3 origin(20, 17, 23);
      const auto met =
          met_by(made.nodes, triangle_at, origin, glm::normalize(box.center() - origin));
      REQUIRE(std::ranges::binary_search(met, i));
    }

    pose([&](vec3 p, u32) {
      return glm::any(glm::isnan(p)) ? p : 9.0f * vec3(random.next2(), 0.5f);
    });
    const auto scattered = *gpu.builder.build(soup.view, {first.get(), soup.view});
    CHECK(has_nodes(cuda::view_of_mesh(*scattered, soup.view), built_at_once()));
  }
}
