// Cost of one edit in a large scene, without the wire: microseconds of its thread's own time,
// median and worst.
//  usage: bench_edits [ENTITIES]
#include <sys/resource.h>
#include <time.h>

#include <algorithm>
#include <cstdlib>
#include <functional>

#include <fmt/format.h>

#include "renderer/scene/labels.h"
#include "renderer/scene/motion.h"
#include "renderer/scene/scene.h"

using namespace heliograph;

namespace {

double thread_microseconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) * 1e6 + double(now.tv_nsec) * 1e-3;
}

void report(const char* what, u32 rounds, const std::function<void(u32)>& work) {
  std::vector<double> times;
  for (u32 round = 0; round < rounds; ++round) {
    const double start = thread_microseconds();
    work(round);
    times.push_back(thread_microseconds() - start);
  }
  std::ranges::sort(times);
  fmt::print("{:<44} {:>12.1f} {:>12.1f}\n", what, times[times.size() / 2], times.back());
}

Edit named(std::string name, Action action) {
  return {.target = std::move(name), .action = std::move(action)};
}
mat4x3 at(float x) {
  mat4x3 pose(1);
  pose[3].x = x;
  return pose;
}
PutEntity placed(float x) { return {.pose = PosePatch{.times = {}, .matrices = {at(x)}}}; }

PutMesh triangle() {
  MeshTopology topology{.vertex_count = 3};
  topology.triangles = ArrayOf<uvec3>(std::vector<uvec3>{{0, 1, 2}});
  VertexKeys keys{.times = {0}, .positions = ArrayOf(std::vector<vec3>(3)), .normals = {}};
  return {.topology = std::make_shared<const MeshTopology>(std::move(topology)),
          .vertices = std::make_shared<const VertexKeys>(std::move(keys))};
}

std::shared_ptr<const Snapshot> step(const Snapshot& base, std::vector<Edit> edits) {
  auto prepared = apply(base, {std::move(edits)}, {});
  if (!prepared) {
    fmt::print(stderr, "{}: {}\n", prepared.error().where, prepared.error().message);
    std::exit(1);
  }
  return prepared->snapshot;
}

void report_edits(std::shared_ptr<const Snapshot> scene, u32 entities) {
  const auto name = [&](u32 round) { return fmt::format("p/{}", round * 7919ull % entities); };
  const auto edit = [&](const char* what, const std::function<std::vector<Edit>(u32)>& edits) {
    auto head = scene;
    report(what, 200, [&](u32 round) { head = step(*head, edits(round)); });
  };
  edit("one pose, by name", [&](u32 r) { return std::vector{named(name(r), placed(float(r)))}; });
  edit("one material of an entity",
       [&](u32 r) { return std::vector{named(name(r), PutEntity{.materials = {{Id{}}}})}; });
  edit("one shared material", [&](u32) {
    PutMaterial rough;
    rough.parameters[2].value = vec3(0.1f);
    return std::vector{named("mat", rough)};
  });
  edit("one new entity", [&](u32 r) {
    return std::vector{named(fmt::format("new {}", r), PutEntity{.mesh = "tri"})};
  });
  edit("one removal", [&](u32 r) { return std::vector{named(name(r), Remove{})}; });
  edit("advance", [&](u32) { return std::vector{Edit{.action = Advance{.dt = 0.1}}}; });
  edit("advance and 1000 poses", [&](u32 r) {
    std::vector<Id> ids;
    for (u32 k = 0; k < 1000; ++k) ids.push_back(scene->entity_id((r + k * 97) % entities));
    const Poses poses{ArrayOf(std::move(ids)), ArrayOf(std::vector(1000, at(float(r))))};
    return std::vector{Edit{.action = Advance{.dt = 0.1}}, Edit{.action = poses}};
  });
  report("a refused name", 20, [&](u32) { (void)scene->find("p/12x45"); });
  report("a branch", 200, [&](u32) { (void)std::make_shared<const Snapshot>(*scene); });
  report("world poses of all", 20, [&](u32) { (void)world_poses(*scene, scene->time); });
  report("labels of all", 20, [&](u32) { (void)label_entities(*scene); });
  report("describe all", 5, [&](u32) { (void)describe(*scene); });
}

}  // namespace

int main(int argc, char** argv) {
  const u32 entities = argc > 1 ? u32(std::atoi(argv[1])) : 100'000;
  fmt::print("{} entities{:>52} {:>12}\n", entities, "median us", "worst us");
  std::shared_ptr<const Snapshot> scene;
  report("build", 1, [&](u32) {
    Instances many{.prototype = {.mesh = "tri", .materials = {{"mat"}}}, .matrices = {}};
    for (u32 k = 0; k < entities; ++k) many.matrices.push_back(at(float(k)));
    scene = step({}, {named("tri", triangle()), named("mat", PutMaterial{}), named("p", many)});
  });
  report_edits(scene, entities);
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  fmt::print("peak memory {} MiB\n", usage.ru_maxrss / 1024);
}
