// Instances that the GPU's program makes of slots and poses, run on the host.
#include "renderer/backend/cuda/place.h"

#include "renderer/backend/cuda/programs.h"
#include "tests/unit/catch.h"
#include "tests/unit/fake_driver.h"
#include "tests/unit/gpu_fibers.h"
#include "tests/unit/random.h"

#include "renderer/backend/cuda/place.cu"

using namespace heliograph;
using namespace heliograph::test;
using cuda::Context;
using cuda::InstancePlacer;

std::span<const std::byte* const> heliograph::cuda::programs() {
  static const std::byte any{};
  static const std::byte* const all[] = {&any};
  return all;
}

namespace {

/// A driver that runs the program.
cuda::Driver running_driver() {
  cuda::Driver d = fake_driver();
  d.function_in = [](cuda::FunctionHandle* out, cuda::ModuleHandle, const char*) {
    return *out = reinterpret_cast<cuda::FunctionHandle>(&place_instances), 0;
  };
  d.launch = [](cuda::FunctionHandle, unsigned blocks, unsigned, unsigned, unsigned threads,
                unsigned, unsigned, unsigned, cuda::StreamHandle, void** arguments, void**) {
    const auto& launch = *static_cast<const PlaceLaunch*>(arguments[0]);
    run_on_fibers(blocks, threads, [&] { place_instances(launch); });
    return 0;
  };
  return d;
}

}  // namespace

TEST_CASE("place: instances are in their places, and hidden where they have none") {
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
  const auto context = Context::create(running_driver(), 0);
  REQUIRE(context);
  const auto placer = InstancePlacer::create(*context);
  REQUIRE(placer);
  REQUIRE(placer->place({slots.data(), world.data(), keys.data(), made.data(), kCount}));
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
