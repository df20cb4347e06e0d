// Trees over instances and triangles that a GPU builds: milliseconds a build and, in a second line,
// of each program of it when the host waits for each; whether they repeat bit for bit, whether they
// are those of the same steps on this processor, and how many steps rays take in them against the
// host's trees. usage: bench_gpu_builders   (needs an NVIDIA GPU)
#include <algorithm>
#include <chrono>
#include <cstring>
#include <map>
#include <random>
#include <string>

#include <fmt/format.h>

#include "kernels/bvh/bvh_tracer.h"
#include "renderer/backend/cuda/build.h"
#include "renderer/bvh/build.h"
#include "tests/unit/bvh_loops.h"

using namespace heliograph;
using cuda::Context;
using cuda::DeviceMemory;
using kernels::BvhBox;

namespace {

constexpr u32 kRounds = 21, kRays = 100'000;

[[noreturn]] void stop(const Error& error) {
  fmt::print(stderr, "bench_gpu_builders: {}\n", error.message);
  std::exit(1);
}
template <class T>
T sure(Expected<T> value) {
  if (!value) stop(value.error());
  return *std::move(value);
}
void sure(const Status& status) {
  if (!status) stop(status.error());
}

template <class T>
DeviceMemory on_device(Context& context, const std::vector<T>& values) {
  auto memory = sure(context.allocate(values.size() * sizeof(T)));
  sure(context.upload(memory.at(), std::as_bytes(std::span(values))));
  return memory;
}
template <class T>
std::vector<T> on_host(Context& context, const T* from, u64 count) {
  std::vector<T> values(count);
  sure(context.download(std::as_writable_bytes(std::span(values)), cuda::DevicePointer(from)));
  return values;
}

/// Balls of several sizes with their centres in a cube, one a cubic metre.
std::vector<kernels::InstanceView> random_balls(u32 count) {
  std::mt19937 engine{7};
  const float half = std::cbrt(float(count)) / 2;
  std::uniform_real_distribution<float> place(-half, half), size(0.1f, 0.6f);
  std::vector<kernels::InstanceView> balls(count);
  for (kernels::InstanceView& ball : balls) {
    const float r = size(engine), x = place(engine), y = place(engine);
    ball.world_from_object = mat4x3(r, 0, 0, 0, r, 0, 0, 0, r, x, y, place(engine));
    ball.object_from_world = kernels::inverse_of(ball.world_from_object);
    ball.visibility = kernels::kAllRays;
  }
  return balls;
}

/// A tree on the host.
struct HostTree {
  std::vector<kernels::BvhNode> nodes;
  std::vector<kernels::BvhInstance> items;
};

/// Steps of rays' walks, and a sum of what they meet.
struct Walks {
  u64 steps = 0;
  double met = 0;
};
Walks walk(const std::vector<kernels::InstanceView>& balls, const HostTree& tree) {
  kernels::MeshView mesh{};
  mesh.shape = kernels::Shape::kSphere;
  kernels::SceneView scene{};
  scene.instances = balls.data();
  scene.instance_count = u32(balls.size());
  scene.meshes = &mesh;
  const kernels::BvhView bvh{tree.nodes.data(), tree.items.data(), nullptr,
                             nullptr,           u32(balls.size()), {}};
  std::mt19937 engine{9};
  const float half = std::cbrt(float(balls.size())) / 2;
  std::uniform_real_distribution<float> place(-half, half), turn(-1, 1);
  Walks walks;
  for (u32 i = 0; i < kRays; ++i) {
    const auto random = [&](auto& of) {
      const float x = of(engine), y = of(engine);
      return vec3(x, y, of(engine));
    };
    kernels::Ray ray{};
    ray.origin = random(place);
    ray.direction = glm::normalize(random(turn) + vec3(1e-6f));
    ray.t_max = INFINITY;
    kernels::BvhStack stack;
    kernels::BvhWalk walk(scene, bvh, stack);
    walk.begin(ray, kernels::kAllRays, false);
    do ++walks.steps;
    while (walk.step());
    const kernels::Hit hit = walk.hit();
    if (hit.instance != kernels::kNone) walks.met += double(hit.t) + double(hit.instance);
  }
  return walks;
}

HostTree host_tree(const std::vector<kernels::InstanceView>& balls, std::span<const u32> order,
                   std::vector<kernels::BvhNode> nodes) {
  HostTree tree{std::move(nodes), {}};
  for (const u32 i : order) tree.items.push_back(kernels::bvh_instance(balls[i], i, {}));
  return tree;
}

template <class T>
u64 differing(const std::vector<T>& a, const std::vector<T>& b) {
  u64 count = 0;
  for (u64 i = 0; i < std::min(a.size(), b.size()); ++i)
    count += std::memcmp(&a[i], &b[i], sizeof(T)) != 0;
  return count + std::max(a.size(), b.size()) - std::min(a.size(), b.size());
}

// A driver that waits for each program, when it is told to, and knows what each took.

cuda::Driver plain;
bool waits = false;
std::map<cuda::FunctionHandle, std::string> names;
std::map<std::string, double> spent;  // ms

cuda::Driver watched(const cuda::Driver& driver) {
  plain = driver;
  cuda::Driver watch = driver;
  watch.function_in = [](cuda::FunctionHandle* f, cuda::ModuleHandle in, const char* name) {
    const cuda::Result result = plain.function_in(f, in, name);
    if (result == 0) names[*f] = name;
    return result;
  };
  watch.launch = [](cuda::FunctionHandle f, unsigned x, unsigned y, unsigned z, unsigned bx,
                    unsigned by, unsigned bz, unsigned shared, cuda::StreamHandle stream,
                    void** arguments, void** extra) {
    if (waits) (void)plain.wait_for_stream(stream);
    const auto start = std::chrono::steady_clock::now();
    const auto result = plain.launch(f, x, y, z, bx, by, bz, shared, stream, arguments, extra);
    if (!waits) return result;
    (void)plain.wait_for_stream(stream);
    spent[names[f]] +=
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    return result;
  };
  return watch;
}

/// Prints milliseconds of each program of a build, a launch and a wait included.
template <class F>
void print_programs(const F& build) {
  spent.clear();
  waits = true;
  for (u32 round = 0; round < kRounds; ++round) build();
  waits = false;
  fmt::print("        ");
  for (const auto& [name, all] : spent) fmt::print(" {} {:.3f}", name, all / kRounds);
  fmt::print("\n");
}

/// Milliseconds of builds.
struct Times {
  double median, worst;
  double launch;  // until the host is free; median
};
template <class F>
Times time_of(Context& context, const F& build) {
  using Clock = std::chrono::steady_clock;
  std::vector<double> done, launched;
  for (u32 round = 0; round < kRounds; ++round) {
    sure(context.wait());
    const auto start = Clock::now();
    build();
    launched.push_back(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
    sure(context.wait());
    done.push_back(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
  }
  std::ranges::sort(done);
  std::ranges::sort(launched);
  return {done[kRounds / 2], done.back(), launched[kRounds / 2]};
}

void measure(const std::shared_ptr<Context>& context, const cuda::TreeBuilder& builder, u32 count) {
  const auto balls = random_balls(count);
  const std::vector<kernels::MeshBvh> meshes(1);
  const std::vector<BvhBox> mesh_boxes{{vec3(-1), vec3(1)}};
  const DeviceMemory instances = on_device(*context, balls), table = on_device(*context, meshes);
  const cuda::BuildInput input{instances.as<const kernels::InstanceView>(), nullptr,
                               table.as<const kernels::MeshBvh>(), count, mesh_boxes};
  const Times times = time_of(*context, [&] { (void)sure(builder.build(input)); });

  std::vector<BvhBox> boxes;
  std::vector<bvh::Box> host_boxes;
  for (const kernels::InstanceView& ball : balls) {
    boxes.push_back(kernels::ray_box(ball, nullptr, mesh_boxes[0]));
    host_boxes.push_back({boxes.back().lower, boxes.back().upper});
  }
  const test::LoopBuild steps(boxes, 2, test::LoopOrder::kForwards);
  const auto start = std::chrono::steady_clock::now();
  const auto sah = sure(bvh::build_tree(host_boxes, {.item_cost = 2}, {}));
  const std::chrono::duration<double, std::milli> host_time =
      std::chrono::steady_clock::now() - start;

  std::vector<HostTree> made;
  for (u32 round = 0; round < 2; ++round) {
    const auto top = sure(builder.build(input));
    const kernels::BvhView view = cuda::view_of_top(*top, input);
    made.push_back(
        {on_host(*context, view.top, steps.nodes().size()), on_host(*context, view.items, count)});
  }
  const u64 repeats =
      differing(made[0].nodes, made[1].nodes) + differing(made[0].items, made[1].items);
  std::vector<u32> found(count);
  for (const kernels::BvhInstance& item : made[0].items) ++found.at(item.instance);
  const HostTree own = host_tree(balls, steps.items(), steps.nodes());
  const Walks gpu = walk(balls, made[0]),
              host = walk(balls, host_tree(balls, sah.items, sah.nodes));
  fmt::print("{:>8} {:>9.3f} {:>9.3f} {:>9.3f} {:>10.2f} {:>8} {:>8} {:>7.2f} {:>7.2f} {}\n", count,
             times.median, times.worst, times.launch, host_time.count(), repeats,
             differing(made[0].nodes, own.nodes), double(host.steps) / kRays,
             double(gpu.steps) / kRays,
             gpu.met == host.met && std::ranges::count(found, 1u) == count ? "same hits" : "WRONG");
  print_programs([&] { (void)sure(builder.build(input)); });
}

/// A bumpy sheet of 2 * side * side triangles.
void measure_mesh(const std::shared_ptr<Context>& context, const cuda::TreeBuilder& builder,
                  u32 side) {
  std::vector<vec3> positions;
  std::vector<uvec3> triangles;
  for (u32 y = 0; y <= side; ++y)
    for (u32 x = 0; x <= side; ++x) {
      const float u = float(x) / float(side), v = float(y) / float(side);
      positions.emplace_back(u, v, 0.05f * std::sin(40 * u) * std::cos(30 * v));
      if (x == side || y == side) continue;
      const u32 a = y * (side + 1) + x, b = a + side + 1;
      triangles.emplace_back(a, a + 1, b);
      triangles.emplace_back(a + 1, b + 1, b);
    }
  kernels::MeshView mesh{};
  mesh.triangles = triangles.data();
  mesh.positions = positions.data();
  mesh.triangle_count = u32(triangles.size());
  mesh.vertex_count = u32(positions.size());
  std::vector<BvhBox> boxes;
  for (u32 i = 0; i < mesh.triangle_count; ++i) boxes.push_back(kernels::primitive_box(mesh, i));
  const test::LoopBuild steps(boxes, 0.3f, test::LoopOrder::kForwards);
  const DeviceMemory corners = on_device(*context, triangles);
  const DeviceMemory places = on_device(*context, positions);
  mesh.triangles = corners.as<const uvec3>();
  mesh.positions = places.as<const vec3>();
  const Times times = time_of(*context, [&] { (void)sure(builder.build(mesh)); });
  std::vector<std::vector<kernels::BvhNode>> nodes;
  std::vector<u32> found(mesh.triangle_count);
  for (u32 round = 0; round < 2; ++round) {
    const auto tree = sure(builder.build(mesh));
    const kernels::MeshBvh view = cuda::view_of_mesh(*tree, mesh);
    nodes.push_back(on_host(*context, view.nodes, steps.nodes().size()));
    if (round == 0)
      for (const auto& item : on_host(*context, view.triangles, mesh.triangle_count))
        ++found.at(item.number);
  }
  fmt::print("{:>8} {:>9.3f} {:>9.3f} {:>9.3f} {:>10} {:>8} {:>8} triangles {}\n",
             mesh.triangle_count, times.median, times.worst, times.launch, "",
             differing(nodes[0], nodes[1]), differing(nodes[0], steps.nodes()),
             std::ranges::count(found, 1u) == mesh.triangle_count ? "each once" : "WRONG");
  print_programs([&] { (void)sure(builder.build(mesh)); });
}

}  // namespace

int main() {
  const auto driver = watched(sure(cuda::load_driver()));
  const auto context = sure(Context::create(driver, 0));
  sure(context->enter());
  const auto builder = sure(cuda::TreeBuilder::create(context));
  fmt::print("{}\n{:>8} {:>9} {:>9} {:>9} {:>10} {:>8} {:>8} {:>7} {:>7}\n", context->name(),
             "count", "median ms", "worst ms", "launch ms", "host ms", "repeat", "steps'", "host",
             "gpu");
  for (const u32 count : {2u, 100u, 512u, 1'000u, 10'000u, 100'000u, 1'000'000u})
    measure(context, builder, count);
  for (const u32 side : {71u, 224u, 708u}) measure_mesh(context, builder, side);
}
