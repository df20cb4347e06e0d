// A context that the driver gave up: what it had is the device's again, whoever still holds it.
#include "renderer/backend/cuda/context.h"

#include <set>

#include "tests/unit/catch.h"
#include "tests/unit/fake_driver.h"

using namespace heliograph;
using namespace heliograph::test;
using namespace heliograph::cuda;

namespace {

constexpr Result kIllegalAddress = 700;

/// A driver whose contexts may be faulty: then every call in one fails, but its end.
struct FakeGpu {
  u64 made = 0;  // contexts
  std::set<u64> contexts;
  u64 current = 0, faulty = 0, primary = 0;
  std::set<DevicePointer> memory;
  bool refuses_contexts = false;
};
FakeGpu* gpu = nullptr;

Result status() {
  if (!gpu->contexts.contains(gpu->current)) return 201;  // CUDA_ERROR_INVALID_CONTEXT
  return gpu->current == gpu->faulty ? kIllegalAddress : 0;
}

Driver faulty_driver() {
  Driver d = fake_driver();
  d.create_context = [](ContextHandle* context, unsigned, Device) {
    if (gpu->refuses_contexts) return kIllegalAddress;
    gpu->contexts.insert(gpu->current = ++gpu->made);
    return *context = reinterpret_cast<ContextHandle>(gpu->current), 0;
  };
  d.destroy_context = [](ContextHandle context) {
    return gpu->contexts.erase(u64(context)) == 1 ? 0 : 201;
  };
  d.primary_state = [](Device, unsigned*, int* taken) {
    return *taken = gpu->contexts.contains(gpu->primary), 0;
  };
  d.retain_primary = [](ContextHandle* context, Device) {
    if (gpu->refuses_contexts) return kIllegalAddress;
    gpu->contexts.insert(gpu->primary = ++gpu->made);
    return *context = reinterpret_cast<ContextHandle>(gpu->primary), 0;
  };
  d.release_primary = [](Device) { return gpu->contexts.erase(gpu->primary) == 1 ? 0 : 201; };
  d.reset_primary = d.release_primary;
  d.set_context = [](ContextHandle context) { return gpu->current = u64(context), 0; };
  d.allocate = [](DevicePointer* at, std::size_t, StreamHandle) {
    static DevicePointer next = 0;
    if (const Result failed = status()) return failed;
    return gpu->memory.insert(*at = ++next), 0;
  };
  d.release = [](DevicePointer at, StreamHandle) {
    if (const Result failed = status()) return failed;
    return gpu->memory.erase(at) == 1 ? 0 : 1;
  };
  d.wait_for_stream = [](StreamHandle) { return status(); };
  d.error_name = [](Result, const char** name) { return *name = "ILLEGAL_ADDRESS", 0; };
  d.error_text = [](Result, const char** text) { return *text = "no such memory", 0; };
  return d;
}

struct Stage {
  Stage() { gpu = &fake; }
  FakeGpu fake;
};

}  // namespace

TEST_CASE("lost context: its memory goes back, what still holds some may go later, another works") {
  const Stage stage;
  auto context = *Context::create(faulty_driver(), 0);
  auto early = *context->allocate(100), late = *context->allocate(200);
  gpu->faulty = gpu->current;
  const Status told = context->wait();
  REQUIRE_FALSE(told);
  CHECK(told.error().code == Code::kUnavailable);
  CHECK(told.error().message.find("ILLEGAL_ADDRESS") != std::string::npos);
  CHECK(context->is_lost());
  CHECK_FALSE(context->allocate(1));
  early = DeviceMemory();
  CHECK(gpu->memory.size() == 2);  // the driver would not

  context->abandon();
  CHECK(gpu->memory.empty());
  CHECK(gpu->contexts.empty());
  auto other = *Context::create(faulty_driver(), 0);
  const auto fresh = *other->allocate(300);
  late = DeviceMemory();
  context.reset();
  CHECK((gpu->memory.size() == 1 && gpu->contexts.size() == 1));
  CHECK(other->wait());
}

TEST_CASE("lost context: where no other can be made nothing more is asked of the driver") {
  const Stage stage;
  auto context = *Context::create(faulty_driver(), 0);
  auto memory = *context->allocate(100);
  gpu->faulty = gpu->current;
  CHECK_FALSE(context->wait());
  gpu->refuses_contexts = true;
  context->abandon();
  CHECK(gpu->contexts.empty());
  CHECK(gpu->memory.size() == 1);
  memory = DeviceMemory();
  context.reset();
  CHECK(gpu->memory.size() == 1);
  CHECK_FALSE(Context::create(faulty_driver(), 0));
}
