// Cost on the host of new poses of all objects, from an array in memory to a snapshot that is
// published and on to a scene that a GPU renders: milliseconds of each stage, median and worst.
//  usage: bench_poses [OBJECTS [THREADS]]
#include <cmath>
#include <cstdlib>
#include <cstring>

#include <fmt/format.h>
#include <tbb/global_control.h>

#include "bench/objects.h"
#include "renderer/bvh/accelerator.h"
#include "renderer/resident/scene.h"
#include "renderer/scene/scene.h"
#include "server/convert/array.h"

using namespace heliograph;
using namespace heliograph::bench;

namespace {

constexpr u32 kWarm = 70, kRounds = 40;  // a scene keeps 64 revisions

vec3 place_of(u32 object, u32 side) {
  return {object / side / side, object / side % side, object % side};
}

template <class T>
[[nodiscard]] T or_end(Expected<T> result) {
  if (result) return std::move(*result);
  fmt::print(stderr, "{}: {}\n", result.error().where, result.error().message);
  std::exit(1);
}

std::shared_ptr<const Snapshot> grid(u32 objects, u32 side) {
  Instances many{.prototype = {.mesh = "body", .materials = {{"paint"}}}, .matrices = {}};
  for (u32 k = 0; k < objects; ++k) {
    mat4x3 pose(1);
    pose[3] = place_of(k, side);
    many.matrices.push_back(pose);
  }
  const auto named = [](std::string name, Action action) {
    return Edit{.target = std::move(name), .action = std::move(action)};
  };
  const Transaction made{
      {named("body", tetrahedron()), named("paint", PutMaterial{}), named("o", std::move(many))}};
  return or_end(apply({}, made, {})).snapshot;
}

/// Arrays as a client shares them.
class Memory final : public server::ArraySource {
 public:
  Expected<BufferPtr> bytes(const v1::Array& array) override {
    return array.dtype() == v1::D_TYPE_U64 ? ids : matrices;
  }
  Expected<std::shared_ptr<const Asset>> asset(std::string_view) override {
    return fail(Code::kNotFound, "", "there are none");
  }
  BufferPtr ids, matrices;
};

/// Poses of every object, turned and moved, as rows of 4x4 matrices.
template <class T>
BufferPtr turned(u32 objects, u32 side, u32 round) {
  std::vector<T> numbers;
  numbers.reserve(std::size_t(objects) * 16);
  const T angle = T(0.01) * T(round), c = std::cos(angle), s = std::sin(angle);
  for (u32 k = 0; k < objects; ++k) {
    const vec3 p = place_of(k, side);
    for (const T n : {c, -s, T(0), T(p.x), s, c, T(0), T(p.y), T(0), T(0), T(1),
                      T(p.z + 0.01f * float(round % 7)), T(0), T(0), T(0), T(1)})
      numbers.push_back(n);
  }
  return ArrayOf<T>(std::move(numbers)).buffer();
}

v1::Transaction message_of(u32 objects, v1::DType type) {
  v1::Transaction message;
  v1::Poses* poses = message.add_edits()->mutable_poses();
  poses->mutable_ids()->set_dtype(v1::D_TYPE_U64);
  poses->mutable_ids()->add_shape(objects);
  poses->mutable_matrices()->set_dtype(type);
  for (const u64 n : {u64(objects), u64(4), u64(4)}) poses->mutable_matrices()->add_shape(n);
  return message;
}

class Stages {
 public:
  void begin() { last_ = milliseconds(), stage_ = 0; }
  void end(const char* name) {
    const double now = milliseconds();
    if (stage_ == stages_.size()) stages_.push_back({name, {}});
    stages_[stage_++].times.push_back(now - last_);
    last_ = milliseconds();
  }
  void report(const char* what) {
    for (auto& [name, times] : stages_) {
      times.erase(times.begin(), times.begin() + kWarm);
      std::ranges::sort(times);
      fmt::print("{:<4} {:<34} {:>9.3f} {:>9.3f}\n", what, name, times[times.size() / 2],
                 times.back());
    }
  }

 private:
  struct Stage {
    const char* name;
    std::vector<double> times;
  };
  std::vector<Stage> stages_;
  std::size_t stage_ = 0;
  double last_ = 0;
};

template <class T>
void measure(u32 objects, const char* what, v1::DType type) {
  const u32 side = u32(std::ceil(std::cbrt(objects)));
  const auto first = grid(objects, side);
  Scene scene(first, {});
  const bvh::BvhAccelerator accelerator(0);
  resident::DerivedCache cache(1ull << 32);
  resident::SceneStore store(accelerator, cache, 4ull << 30);
  Memory memory;
  std::vector<u64> ids;
  for (u32 i = 0; i < first->entities.capacity(); ++i) ids.push_back(first->entity_id(i).value);
  memory.ids = ArrayOf(std::move(ids)).buffer();
  const v1::Transaction message = message_of(objects, type);
  Stages stages;
  for (u32 round = 0; round < kWarm + kRounds; ++round) {
    memory.matrices = turned<T>(objects, side, round);
    stages.begin();
    auto transaction = or_end(server::to_transaction(message, memory));
    stages.end("checked and converted");
    auto prepared = or_end(scene.prepare(transaction, std::nullopt));
    stages.end("applied");
    scene.publish(prepared);
    stages.end("published");
    transaction = {};
    stages.end("the transaction freed");
    const auto head = scene.head();
    const auto placed = or_end(store.prepare(head, {head->time, head->time}, Interrupt{}));
    stages.end("placed for a GPU");
  }
  stages.report(what);
}

}  // namespace

int main(int argc, char** argv) {
  const u32 objects = argc > 1 ? u32(std::atoi(argv[1])) : 100'000;
  std::optional<tbb::global_control> threads;
  if (argc > 2)
    threads.emplace(tbb::global_control::max_allowed_parallelism, std::size_t(std::atoi(argv[2])));
  fmt::print("{} objects{:>36} {:>9}\n", objects, "median ms", "worst");
  measure<float>(objects, "f32", v1::D_TYPE_F32);
  measure<double>(objects, "f64", v1::D_TYPE_F64);
}
