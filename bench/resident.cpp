// Cost on the host from an edit that moves one object to a scene that can be rendered:
// milliseconds, median and worst, for the CPU's ray tracer and for the host's part of a GPU's
// scene. Embree's own structures are timed apart. usage: bench_resident [OBJECTS...]
#include <cmath>
#include <cstdlib>

#include <fmt/format.h>

#include "bench/objects.h"
#include "renderer/backend/embree/top_level.h"
#include "renderer/bvh/accelerator.h"
#include "renderer/scene/scene.h"

using namespace heliograph;
using namespace heliograph::bench;
using namespace heliograph::resident;

namespace {

constexpr u32 kWarm = 10, kRounds = 30;

/// Another accelerator, and how long it took over the last placement.
class Timed final : public Accelerator {
 public:
  explicit Timed(const Accelerator& other) : other_(other) {}
  [[nodiscard]] Expected<std::shared_ptr<const MeshAccelerator>> build(
      const DeviceMesh& mesh, const Interrupt& interrupt) const override {
    return other_.build(mesh, interrupt);
  }
  [[nodiscard]] Expected<std::shared_ptr<const SceneAccelerator>> build(
      const Snapshot& snapshot, const Placement& placement, const Kept& kept,
      const Interrupt& interrupt) const override {
    const double start = milliseconds();
    auto made = other_.build(snapshot, placement, kept, interrupt);
    took_ = milliseconds() - start;
    return made;
  }
  [[nodiscard]] double took() const { return took_; }

 private:
  const Accelerator& other_;
  mutable double took_ = 0;
};

mat4x3 at(vec3 place) {
  mat4x3 pose(1);
  pose[3] = place;
  return pose;
}

std::shared_ptr<const Snapshot> edited(const Snapshot& base, std::vector<Edit> edits) {
  auto prepared = apply(base, {std::move(edits)}, {});
  if (!prepared) {
    fmt::print(stderr, "{}: {}\n", prepared.error().where, prepared.error().message);
    std::exit(1);
  }
  return prepared->snapshot;
}

Edit named(std::string name, Action action) {
  return {.target = std::move(name), .action = std::move(action)};
}

std::shared_ptr<const Snapshot> grid(u32 objects) {
  const u32 side = u32(std::ceil(std::cbrt(objects)));
  Instances many{.prototype = {.mesh = "body", .materials = {{"paint"}}}, .matrices = {}};
  for (u32 k = 0; k < objects; ++k)
    many.matrices.push_back(at(vec3(k / side / side, k / side % side, k % side)));
  return edited({}, {named("body", tetrahedron()), named("paint", PutMaterial{}),
                     named("o", std::move(many))});
}

u32 side_of(u32 triangles) { return u32(std::sqrt(double(triangles) / 2)); }

/// Two triangles by square of a sheet that has two morph targets.
PutMesh sheet(u32 side) {
  std::vector<vec3> positions, morphs;
  std::vector<uvec3> triangles;
  for (u32 y = 0; y <= side; ++y)
    for (u32 x = 0; x <= side; ++x) {
      positions.emplace_back(float(x) / float(side), float(y) / float(side), 0);
      if (x == side || y == side) continue;
      const u32 a = y * (side + 1) + x, b = a + side + 1;
      triangles.emplace_back(a, a + 1, b);
      triangles.emplace_back(a + 1, b + 1, b);
    }
  for (const float turn : {20.0f, 35.0f})
    for (const vec3 p : positions) morphs.emplace_back(0, 0, 0.1f * std::sin(turn * p.x * p.y));
  MeshTopology topology{.vertex_count = u32(positions.size())};
  topology.triangles = ArrayOf(std::move(triangles));
  topology.morph_count = 2;
  topology.morph_positions = ArrayOf(std::move(morphs));
  VertexKeys keys{.times = {0}, .positions = ArrayOf(std::move(positions)), .normals = {}};
  return {.topology = std::make_shared<const MeshTopology>(std::move(topology)),
          .vertices = std::make_shared<const VertexKeys>(std::move(keys))};
}

struct Times {
  std::vector<double> edit, prepare, structure;
  void add(double edited, double prepared, double structured) {
    edit.push_back(edited);
    prepare.push_back(prepared - structured);
    structure.push_back(structured);
  }
};

std::string summary(std::vector<double>& times) {
  std::ranges::sort(times);
  return fmt::format("{:.3f} ({:.3f})", times[times.size() / 2], times.back());
}

using Change = std::vector<Edit> (*)(u32 round, u32 objects);

std::vector<Edit> moved(u32 round, u32 objects) {
  const PutEntity there{
      .pose = PosePatch{.times = {}, .matrices = {at(vec3(0.01f * float(round), 0.3f, 0.2f))}}};
  return {named(fmt::format("o/{}", round * 7919ull % objects), there)};
}
std::vector<Edit> painted(u32 round, u32 objects) {
  PutEntity bare;
  if (round % 2 == 0)
    bare.materials = std::vector<Ref>{Ref("paint")};
  else
    bare.materials = std::vector<Ref>{Ref(Id{})};
  return {named(fmt::format("o/{}", round * 7919ull % objects), bare)};
}
std::vector<Edit> added(u32 round, u32) {
  return {named(fmt::format("new {}", round), PutEntity{.mesh = "body"})};
}
std::vector<Edit> advanced_and_moved(u32 round, u32 objects) {
  auto edits = moved(round, objects);
  edits.insert(edits.begin(), Edit{.action = Advance{.dt = 0.1}});
  return edits;
}

std::vector<Edit> bent(u32 round, u32) {
  const float bend = 0.01f * float(round);
  return {named("sheet", PutEntity{.mesh = "sheet/mesh",
                                   .morph_weights = MorphWeights{{}, {1 - bend, 1 + bend}}})};
}

std::vector<Edit> reshaped(u32 round, u32 objects) {
  VertexKeys keys = *sheet(side_of(objects)).vertices;
  std::vector<vec3> positions(keys.positions.begin(), keys.positions.end());
  positions[round].z += 0.1f;
  keys.positions = ArrayOf(std::move(positions));
  return {named("sheet/mesh", PutMesh{.topology = nullptr,
                                      .vertices = std::make_shared<const VertexKeys>(keys)})};
}

/// overlay   each change is of the same scene, otherwise of what the one before made
void measure(u32 objects, const Accelerator& accelerator, const char* who, const char* what,
             Change change, bool overlay, bool flat) {
  const Timed timed(accelerator);
  DerivedCache cache(1ull << 32);
  SceneStore store(timed, cache, 4ull << 30);
  auto head = change != bent && change != reshaped
                  ? grid(objects)
                  : edited({}, {named("sheet/mesh", sheet(side_of(objects))),
                                named("sheet", PutEntity{.mesh = "sheet/mesh"})});
  const double blur = change == advanced_and_moved ? 0.05 : 0;
  Times times;
  const auto prepare = [&](const std::shared_ptr<const Snapshot>& snapshot) {
    auto scene = store.prepare(snapshot, {snapshot->time - blur, snapshot->time}, Interrupt{});
    if (!scene) std::exit(1);
    if (flat && !(*scene)->view().instances) std::exit(1);
  };
  prepare(head);
  for (u32 round = 0; round < kWarm + kRounds; ++round) {
    auto edits = change(round, objects);
    const double start = milliseconds();
    const auto next = edited(*head, std::move(edits));
    const double applied = milliseconds();
    prepare(next);
    const double ended = milliseconds();
    if (round >= kWarm) times.add(applied - start, ended - applied, timed.took());
    if (!overlay) head = next;
  }
  fmt::print("{:>8} {:<7} {:<26} {:<18} {:<20} {}\n", objects, who, what, summary(times.edit),
             summary(times.prepare), summary(times.structure));
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<u32> counts;
  for (int i = 1; i < argc; ++i) counts.push_back(u32(std::atoi(argv[i])));
  if (counts.empty()) counts = {1000, 100'000};
  const embree::DeviceHandle device(rtcNewDevice(nullptr));
  const embree::EmbreeAccelerator on_cpu(device.get(), 0);
  const bvh::BvhAccelerator for_gpu(0);
  fmt::print("{:>8} {:<7} {:<26} {:<18} {:<20} {}\n", "objects", "rays", "what", "edit ms",
             "scene ms", "their structure ms");
  for (const u32 objects : counts) {
    measure(objects, on_cpu, "embree", "an overlay moves one", moved, true, true);
    measure(objects, for_gpu, "gpu", "an overlay moves one", moved, true, false);
    measure(objects, for_gpu, "gpu", "an edit moves one", moved, false, false);
    measure(objects, for_gpu, "gpu", "advance, blur, one moves", advanced_and_moved, false, false);
    measure(objects, for_gpu, "gpu", "one gets a material", painted, false, false);
    measure(objects, for_gpu, "gpu", "one is added", added, false, false);
    measure(objects, for_gpu, "gpu", "a sheet of so many bends", bent, false, false);
    measure(objects, for_gpu, "gpu", "the same with new vertices", reshaped, false, false);
  }
}
