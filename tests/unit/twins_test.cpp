// Numbers that the device takes: what its programs make of them, run on the host, where both sides
// lie, and how long.
#include <numeric>

#include "renderer/backend/cuda/mirror.h"
#include "tests/unit/catch.h"
#include "tests/unit/fake_driver.h"
#include "tests/unit/gpu_fibers.h"
#include "tests/unit/random.h"

#include "renderer/backend/cuda/take.cu"

using namespace heliograph;
using namespace heliograph::test;
using cuda::Context;
using cuda::ExportSource;
using cuda::Twins;

namespace {

constexpr u32 kMany = 1'500;  // of poses that the device takes

using Program = void (*)(TakeLaunch);

cuda::FunctionHandle handle_of(Program program) {
  return reinterpret_cast<cuda::FunctionHandle>(program);
}

/// A driver that runs the programs, and has memory that others map.
cuda::Driver running_driver() {
  cuda::Driver d = fake_driver();
  d.granularity = [](std::size_t* step, const cuda::AllocationProperties*, int) {
    return *step = 1 << 20, 0;
  };
  d.device_uuid = [](void*, cuda::Device) { return 0; };
  d.launch = [](cuda::FunctionHandle f, unsigned blocks, unsigned, unsigned, unsigned threads,
                unsigned, unsigned, unsigned, cuda::StreamHandle, void** arguments, void**) {
    const auto& launch = *static_cast<const TakeLaunch*>(arguments[0]);
    run_on_fibers(blocks, threads, [&] { reinterpret_cast<Program>(f)(launch); });
    return 0;
  };
  return d;
}

struct Gpu {
  explicit Gpu(u64 most = 64 << 20)
      : twins(std::make_shared<Twins>(context, context->export_device(), most)) {
    source->set_takes({.floats = handle_of(take_floats),
                       .poses = handle_of(take_poses),
                       .poses_f64 = handle_of(take_poses_f64),
                       .fewest = 64 << 10},
                      twins);
  }
  /// What the device takes of numbers that lie there.
  template <class T>
  [[nodiscard]] BufferPtr take(const std::vector<T>& numbers, Numbers kind) const {
    auto taken =
        source->take(cuda::DevicePointer(numbers.data()), numbers.size() * sizeof(T), kind);
    REQUIRE(taken);
    return *taken;
  }
  cuda::Driver driver = running_driver();
  std::shared_ptr<Context> context = Context::create(driver, 0).value();
  std::shared_ptr<ExportSource> source =
      ExportSource::create(context, context->export_device()).value();
  std::shared_ptr<Twins> twins;
};

/// Row-major matrices, each another.
template <class T>
std::vector<T> matrices(u32 count) {
  Random random(count);
  std::vector<T> numbers;
  for (u32 i = 0; i < count; ++i) {
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column)
        numbers.push_back(T(row == column ? 2 + random.next() : random.next()));
    numbers.insert(numbers.end(), {T(0), T(0), T(0), T(1)});
  }
  return numbers;
}

template <class T>
void check_poses(Numbers kind) {
  const Gpu gpu;
  const auto numbers = matrices<T>(kMany);
  const BufferPtr taken = gpu.take(numbers, kind);
  REQUIRE(taken);
  CHECK(taken->kind() == Buffer::Kind::kPooled);
  const ArrayOf<mat4x3> poses(taken);
  REQUIRE(poses.size() == kMany);
  for (u32 i = 0; i < kMany; ++i) {
    mat4x3 pose;
    REQUIRE(take_affine(&numbers[16 * std::size_t(i)], pose));
    REQUIRE(poses[i] == pose);
  }
  for (const auto& [number, value] :
       {std::pair{5u, T(NAN)}, std::pair{16u * 1'499 + 3, T(INFINITY)},
        std::pair{16u * 7 + 12, T(1)}, std::pair{16u * 9 + 15, T(0.5)}}) {
    auto bad = numbers;
    bad[number] = value;
    CHECK_FALSE(gpu.take(bad, kind));
  }
  auto flat = numbers;
  for (int row = 0; row < 3; ++row) flat[16 * 100 + 4 * row] = 0;
  CHECK_FALSE(gpu.take(flat, kind));
}

}  // namespace

TEST_CASE("twins: the device takes poses as the host does, or none") {
  check_poses<float>(Numbers::kPoses);
  check_poses<double>(Numbers::kPosesF64);
}

TEST_CASE("twins: the device takes floats that are finite, if they are many") {
  const Gpu gpu;
  std::vector<float> numbers(20'000);
  std::iota(numbers.begin(), numbers.end(), -1000.0f);
  const BufferPtr taken = gpu.take(numbers, Numbers::kFloats);
  REQUIRE(taken);
  CHECK(std::ranges::equal(ArrayOf<float>(taken), numbers));
  numbers[19'999] = -INFINITY;
  CHECK_FALSE(gpu.take(numbers, Numbers::kFloats));
  numbers.resize(1000);
  CHECK_FALSE(gpu.take(numbers, Numbers::kFloats));
}

TEST_CASE("twins: what the host has of one is copied on the device, whatever part") {
  const Gpu gpu;
  const BufferPtr taken = gpu.take(matrices<float>(kMany), Numbers::kPoses);
  const std::span<const mat4x3> poses = ArrayOf<mat4x3>(taken).span();
  // A table of its chunks, in one of which a row is another.
  ChunkedArray<mat4x3> table = ChunkedArray<mat4x3>::unwritten(kMany);
  for (u32 c = 0; c < table.chunk_count(); ++c) {
    const u32 first = c * ChunkedArray<mat4x3>::kRows;
    table.put_chunk(c, poses.subspan(first, std::min<std::size_t>(256, kMany - first)), taken);
  }
  CHECK(table.chunk(3).data() == &poses[768]);
  table.write(300) = mat4x3(7);
  CHECK(table.chunk(1).data() != &poses[256]);
  CHECK(poses[300] != mat4x3(7));
  cuda::Mirror mirror(gpu.context, gpu.twins);
  CHECK(mirror.has_twin(taken->bytes()));
  CHECK(mirror.has_twin(taken->bytes().subspan(100, 50)));
  CHECK_FALSE(mirror.has_twin(std::as_bytes(table.chunk(1))));
  cuda::Copies copies(mirror);
  const mat4x3* all = copies.of_own(table);
  const mat4x3* whole = copies.of(poses.data(), poses.size());
  REQUIRE(copies.finish());
  CHECK(gpu.context->uploaded_bytes() == 256 * sizeof(mat4x3));
  for (u32 i = 0; i < kMany; ++i) {
    REQUIRE(all[i] == table[i]);
    REQUIRE(whole[i] == poses[i]);
  }
}

TEST_CASE("twins: room is used again when nobody holds it, and there is no more than that") {
  const Gpu gpu(5 << 20);
  const auto numbers = matrices<float>(2'000);  // 96,000 bytes
  BufferPtr first = gpu.take(numbers, Numbers::kPoses), second = gpu.take(numbers, Numbers::kPoses);
  REQUIRE((first && second));
  CHECK_FALSE(gpu.take(numbers, Numbers::kPoses));
  const std::byte* where = first->bytes().data();
  const std::vector<std::byte> before(second->bytes().begin(), second->bytes().end());
  first.reset();
  CHECK_FALSE(gpu.twins->has({where, 1}));
  const BufferPtr third = gpu.take(matrices<float>(kMany), Numbers::kPoses);
  REQUIRE(third);
  CHECK(third->bytes().data() == where);
  CHECK(std::ranges::equal(before, second->bytes()));
  CHECK_FALSE(gpu.twins->reclaim());
  second.reset();
  CHECK(gpu.context->budget().used() > 4'000'000);
  CHECK(gpu.twins->reclaim());
  CHECK(gpu.context->budget().used() < 3'000'000);
}

TEST_CASE("twins: what the host has outlives the device") {
  BufferPtr taken;
  {
    Gpu gpu;
    taken = gpu.take(matrices<float>(kMany), Numbers::kPoses);
    gpu.context->abandon();
    const auto more = gpu.source->take(cuda::DevicePointer(taken->bytes().data()),
                                       taken->bytes().size(), Numbers::kFloats);
    CHECK((!more || !*more));
  }
  REQUIRE(taken);
  CHECK(ArrayOf<mat4x3>(taken)[kMany - 1][0].x >= 2);
}
