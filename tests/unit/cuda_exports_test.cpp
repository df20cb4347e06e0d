// Exportable device memory against a driver of memfds, which counts what is not given back.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "renderer/backend/cuda/exports.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::cuda;

namespace {

constexpr Result kRefused = 1;
constexpr u64 kStep = 2 << 20;

struct FakeDevice {
  std::map<MemoryHandle, int> handles;    // -> memfd
  std::map<DevicePointer, u64> reserved;  // -> bytes
  std::map<DevicePointer, u64> mapped;    // -> bytes
  std::string refuses;                    // the function that fails from now on
  u32 cached = 0;                         // attempts that fail until the pool is trimmed
  bool is_pending = false;                // work is on its way
  bool was_unmapped_early = false;
  int virtual_memory = 1;
  int streams = 0;  // and stages
  int events = 0;
  std::map<void*, std::unique_ptr<std::byte[]>> pinned;  // goes with the context
};
FakeDevice* device = nullptr;

Result allowed(const char* name) { return device->refuses == name ? kRefused : 0; }

Result create_memory(MemoryHandle* handle, std::size_t bytes, const AllocationProperties* wanted,
                     u64) {
  REQUIRE((wanted->kind == 1 && wanted->handle_kinds == 1 && wanted->location.kind == 1));
  REQUIRE((wanted->location.id == 3 && bytes % kStep == 0));
  if (device->cached > 0 || allowed("create") != 0) return kOutOfMemory;
  const int fd = ::memfd_create("fake", MFD_CLOEXEC);
  REQUIRE(::ftruncate(fd, off_t(bytes)) == 0);
  *handle = u64(fd) + 100;
  device->handles[*handle] = fd;
  return 0;
}

Result release_memory(MemoryHandle handle) {
  ::close(device->handles.at(handle));
  device->handles.erase(handle);
  return 0;
}

Result export_memory(void* fd, MemoryHandle handle, int kind, u64) {
  REQUIRE(kind == 1);
  if (allowed("export") != 0) return kRefused;
  *static_cast<int*>(fd) = ::dup(device->handles.at(handle));
  return 0;
}

Result reserve(DevicePointer* at, std::size_t bytes, std::size_t, DevicePointer, u64) {
  if (allowed("reserve") != 0) return kRefused;
  void* start = ::mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  REQUIRE(start != MAP_FAILED);
  *at = DevicePointer(start);
  device->reserved[*at] = bytes;
  return 0;
}

Result unreserve(DevicePointer at, std::size_t bytes) {
  REQUIRE((device->reserved.at(at) == bytes && device->mapped.count(at) == 0));
  ::munmap(reinterpret_cast<void*>(at), bytes);
  device->reserved.erase(at);
  return 0;
}

Result map(DevicePointer at, std::size_t bytes, std::size_t, MemoryHandle handle, u64) {
  if (allowed("map") != 0) return kRefused;
  ::mmap(reinterpret_cast<void*>(at), bytes, PROT_NONE, MAP_SHARED | MAP_FIXED,
         device->handles.at(handle), 0);
  device->mapped[at] = bytes;
  return 0;
}

Result unmap(DevicePointer at, std::size_t bytes) {
  REQUIRE(device->mapped.at(at) == bytes);
  device->was_unmapped_early |= device->is_pending;
  device->mapped.erase(at);
  return 0;
}

Result set_access(DevicePointer at, std::size_t bytes, const AccessDescription* access,
                  std::size_t count) {
  REQUIRE((count == 1 && access->location.id == 3 && access->access == 3));
  if (allowed("access") != 0) return kRefused;
  return ::mprotect(reinterpret_cast<void*>(at), bytes, PROT_READ | PROT_WRITE);
}

Result fill(DevicePointer at, unsigned char byte, std::size_t bytes, StreamHandle) {
  if (allowed("fill") != 0) return kRefused;
  std::ranges::fill_n(reinterpret_cast<unsigned char*>(at), i64(bytes), byte);
  return 0;
}

Driver fake_driver() {
  Driver driver;
  driver.set_context = [](ContextHandle) { return 0; };
  driver.wait_for_stream = [](StreamHandle stream) {
    if (!stream) device->is_pending = false;  // the one that renders
    return 0;
  };
  driver.trim_pool = [](PoolHandle, std::size_t) { return Result(device->cached = 0); };
  driver.pool_value = [](PoolHandle, int, void* value) { return *static_cast<u64*>(value) = 0, 0; };
  driver.device_attribute = [](int* value, int which, Device) {
    *value = which == 102 ? device->virtual_memory : 1;
    return 0;
  };
  driver.granularity = [](std::size_t* bytes, const AllocationProperties*, int) {
    *bytes = kStep;
    return 0;
  };
  driver.device_uuid = [](void* uuid, Device which) {
    std::ranges::fill_n(static_cast<u8*>(uuid), 16, u8(which));
    return 0;
  };
  driver.create_stream = [](StreamHandle* stream, unsigned flags) {
    *stream = reinterpret_cast<StreamHandle>(7);
    return Result(flags != 1 || ++device->streams < 0);
  };
  driver.destroy_stream = [](StreamHandle) { return Result(--device->streams < 0); };
  driver.allocate_pinned = [](void** at, std::size_t bytes, unsigned) {
    ++device->streams;
    auto memory = std::make_unique<std::byte[]>(bytes);
    *at = memory.get();
    device->pinned.emplace(*at, std::move(memory));
    return 0;
  };
  driver.release_pinned = [](void* at) {
    --device->streams;
    return Result(device->pinned.erase(at) != 1);
  };
  driver.create_event = [](EventHandle* event, unsigned flags) {
    *event = reinterpret_cast<EventHandle>(9);
    return Result(flags != 2 || ++device->events < 0);
  };
  driver.destroy_event = [](EventHandle) { return Result(--device->events < 0); };
  driver.record_event = [](EventHandle event, StreamHandle stream) {
    REQUIRE(stream == reinterpret_cast<StreamHandle>(7));
    return Result(event != reinterpret_cast<EventHandle>(9));
  };
  driver.wait_for_event = [](EventHandle event) {
    if (allowed("wait_for_event") != 0) return kRefused;
    return Result(event != reinterpret_cast<EventHandle>(9));
  };
  driver.download = [](void* to, DevicePointer from, std::size_t bytes, StreamHandle stream) {
    if (allowed("download") != 0) return kRefused;
    REQUIRE(stream == reinterpret_cast<StreamHandle>(7));
    return std::memcpy(to, reinterpret_cast<const void*>(from), bytes), 0;
  };
  driver.error_name = [](Result, const char** name) { return *name = "REFUSED", 0; };
  driver.error_text = [](Result, const char** text) { return *text = "so be it", 0; };
  driver.create_memory = create_memory;
  driver.release_memory = release_memory;
  driver.export_memory = export_memory;
  driver.reserve = reserve;
  driver.unreserve = unreserve;
  driver.map = map;
  driver.unmap = unmap;
  driver.access = set_access;
  driver.fill = fill;
  return driver;
}

struct Stage {
  Stage() { device = &fake; }
  FakeDevice fake;
  Driver driver = fake_driver();
  Pool pool{driver};
  Tenure tenure;
  [[nodiscard]] auto source(u64 budget = 1 << 30) {
    pool.budget().set_bytes(budget);
    return ExportSource::create(nullptr,
                                {.driver = driver, .pool = pool, .tenure = tenure, .device = 3});
  }
  [[nodiscard]] std::size_t kept() const {
    return fake.handles.size() + fake.reserved.size() + fake.mapped.size();
  }
};

}  // namespace

TEST_CASE("exports: another process maps what is written, and nothing is left behind") {
  Stage stage;
  const auto source = stage.source();
  REQUIRE(source);
  CHECK((*source)->step() == kStep);
  CHECK(*(*source)->device() == DeviceUuid{3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3});
  auto memory = (*source)->make(2 * kStep);
  REQUIRE(memory);
  REQUIRE(memory->bytes().size() == 2 * kStep);
  CHECK(std::ranges::all_of(memory->bytes(), [](std::byte b) { return b == std::byte(0); }));
  const int fd = ::dup(memory->fd());
  memory->bytes()[kStep] = std::byte(7);
  memory.reset();
  CHECK(stage.kept() == 0);
  std::byte seen{};
  REQUIRE(::pread(fd, &seen, 1, off_t(kStep)) == 1);  // what was imported lives on
  CHECK(seen == std::byte(7));
  ::close(fd);
}

TEST_CASE("exports: nothing is unmapped that work may still write to") {
  Stage stage;
  auto memory = (*stage.source())->make(kStep);
  stage.fake.is_pending = true;
  memory.reset();
  CHECK_FALSE(stage.fake.was_unmapped_early);
  CHECK(stage.kept() == 0);
}

TEST_CASE("exports: what the driver refuses half way is given back") {
  Stage stage;
  const auto source = *stage.source();
  for (const char* name : {"create", "export", "reserve", "map", "access", "fill"}) {
    stage.fake.refuses = name;
    INFO(name);
    CHECK_FALSE(source->make(kStep));
    CHECK(stage.kept() == 0);
    CHECK(stage.pool.budget().used() == 0);
  }
  stage.fake.refuses.clear();
  CHECK(source->make(kStep));
}

TEST_CASE("exports: memory that the pool keeps is had") {
  Stage stage;
  const auto source = *stage.source();
  stage.fake.cached = 1;
  CHECK(source->make(kStep));
}

TEST_CASE("exports: they are of the device's budget, and the driver is not asked beyond it") {
  Stage stage;
  const auto source = *stage.source(4 * kStep);
  bool is_given_up = false;
  stage.pool.budget().set_give_up([&] { return !std::exchange(is_given_up, true); });
  const auto first = source->make(3 * kStep);
  REQUIRE(first);
  CHECK_FALSE(is_given_up);
  CHECK(stage.pool.budget().used() == 3 * kStep);
  CHECK_FALSE(source->make(2 * kStep));
  CHECK(is_given_up);
  CHECK(stage.fake.handles.size() == 1);
  CHECK(source->make(kStep));
}

TEST_CASE("exports: who keeps some is asked for it") {
  struct Keeper final : SharedMemoryKeeper {
    std::shared_ptr<SharedMemory> kept;
    bool let_go(const SharedMemorySource&) override {
      return std::exchange(kept, nullptr) != nullptr;
    }
  };
  Stage stage;
  const auto source = *stage.source(4 * kStep);
  stage.pool.budget().set_give_up([&] { return source->reclaim(); });
  const auto busy = std::make_shared<Keeper>(), keeper = std::make_shared<Keeper>();
  keeper->kept = source->make(3 * kStep);
  for (const auto& each : {busy, keeper, busy}) source->know(each);
  const auto memory = source->make(2 * kStep);
  REQUIRE(memory);
  CHECK_FALSE(keeper->kept);
  CHECK(stage.pool.budget().used() == 2 * kStep);
  CHECK_FALSE(source->make(3 * kStep));
}

TEST_CASE("exports: when the context is gone they are given back without it") {
  Stage stage;
  auto source = *stage.source();
  auto memory = std::dynamic_pointer_cast<LentMemory>(source->make(kStep));
  REQUIRE(memory);
  stage.tenure.end();
  stage.fake.is_pending = true;  // its streams are no more: nobody may wait for one
  CHECK_FALSE(source->make(kStep));
  const auto take = [](u64, std::span<const std::byte>) { FAIL("nothing came"); };
  CHECK(memory->read(0, 1, take).error().code == Code::kUnavailable);
  memory.reset();
  CHECK((stage.kept() == 0 && stage.fake.is_pending));
  CHECK(stage.pool.budget().used() == 0);
  source.reset();
  CHECK(stage.fake.streams == 2);  // the context's own
}

TEST_CASE("exports: what another process has written is read back") {
  Stage stage;
  auto source = *stage.source();
  auto memory = std::dynamic_pointer_cast<LentMemory>(source->make(10 * kStep));
  REQUIRE(memory);
  for (u64 i = 0; i < memory->bytes().size(); ++i) memory->bytes()[i] = std::byte(i * 7 % 251);
  std::vector<std::byte> seen(9 * kStep + 5);  // more than the stage holds
  std::atomic<u64> taken = 0;
  const auto take = [&](u64 begin, std::span<const std::byte> piece) {
    std::ranges::copy(piece, seen.begin() + i64(begin));
    taken += piece.size();
    if (begin + piece.size() < seen.size() && piece.size() % 256 != 0) std::abort();
  };
  REQUIRE(memory->read(3, seen.size(), take));
  CHECK(taken == seen.size());
  CHECK(std::ranges::equal(seen, memory->bytes().subspan(3, seen.size())));
  for (const char* call : {"download", "wait_for_event"}) {
    stage.fake.refuses = call;
    const Status refused = memory->read(0, seen.size(), take);
    REQUIRE_FALSE(refused);
    CHECK(refused.error().code == Code::kUnavailable);
  }
  source.reset();
  CHECK(stage.fake.streams == 2);
  memory.reset();  // the last that reads
  CHECK((stage.fake.streams == 0 && stage.fake.events == 0 && stage.kept() == 0));
}

TEST_CASE("exports: a device without virtual memory has none") {
  Stage stage;
  stage.fake.virtual_memory = 0;
  const auto source = stage.source();
  REQUIRE_FALSE(source);
  CHECK(source.error().code == Code::kUnavailable);
}
