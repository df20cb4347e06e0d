#include "renderer/backend/cuda/exports.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <thread>

#include "renderer/backend/cuda/take_launch.h"
#include "renderer/base/parallel.h"

namespace heliograph::cuda {
namespace {

constexpr int kPinned = 1;            // CU_MEM_ALLOCATION_TYPE_PINNED
constexpr int kDescriptor = 1;        // CU_MEM_HANDLE_TYPE_POSIX_FILE_DESCRIPTOR
constexpr int kOnDevice = 1;          // CU_MEM_LOCATION_TYPE_DEVICE
constexpr int kReadWrite = 3;         // CU_MEM_ACCESS_FLAGS_PROT_READWRITE
constexpr int kMinimum = 0;           // CU_MEM_ALLOC_GRANULARITY_MINIMUM
constexpr unsigned kNonBlocking = 1;  // CU_STREAM_NON_BLOCKING
constexpr unsigned kNoTiming = 2;     // CU_EVENT_DISABLE_TIMING
constexpr u64 kPieceBytes = 2 << 20;  // one is copied while the next ones come
constexpr u64 kStageBytes = ExportSource::kPieces * kPieceBytes;
constexpr u64 kShareBytes = 64 << 10;  // what a thread takes at a time
constexpr u64 kWordBytes = sizeof(u32);
static_assert(kPieceBytes % kShareBytes == 0);

AllocationProperties properties_of(Device device) {
  return {.kind = kPinned, .handle_kinds = kDescriptor, .location = {kOnDevice, device}};
}

class ExportedMemory final : public LentMemory {
 public:
  explicit ExportedMemory(std::shared_ptr<ExportSource> source)
      : source_(std::move(source)), device_(source_->parts()) {}
  ~ExportedMemory() override;

  /// False when the driver refuses.
  [[nodiscard]] bool open(u64 bytes);
  [[nodiscard]] int fd() const override { return fd_; }
  [[nodiscard]] std::span<std::byte> bytes() const override {
    return {reinterpret_cast<std::byte*>(at_), bytes_};
  }
  [[nodiscard]] const DeviceUuid* device() const override { return source_->device(); }
  [[nodiscard]] Status read(u64 offset, u64 size, const TakePiece& take) const override {
    return source_->read(at_ + offset, size, take);
  }
  [[nodiscard]] Expected<BufferPtr> take(u64 offset, u64 size, Numbers kind) const override {
    return source_->take(at_ + offset, size, kind);
  }

 private:
  /// room   what makes room beside the pool
  [[nodiscard]] bool create(void (Pool::*room)());
  [[nodiscard]] bool map();

  const std::shared_ptr<ExportSource> source_;
  const ExportDevice& device_;
  u64 bytes_ = 0;
  MemoryHandle handle_ = 0;
  bool is_taken_ = false, has_handle_ = false, is_mapped_ = false;
  int fd_ = -1;
  DevicePointer at_ = 0;
};

bool ExportedMemory::open(u64 bytes) {
  bytes_ = bytes;
  MemoryBudget& budget = device_.pool.budget();
  is_taken_ = budget.take(bytes).has_value();
  if (!is_taken_) return false;
  if (!create(&Pool::shrink)) {  // others have memory of the device, too
    budget.give_up();
    if (!create(&Pool::trim)) return false;
  }
  return map();
}

bool ExportedMemory::create(void (Pool::*room)()) {
  const auto held = device_.tenure.hold();
  if (!held) return false;
  (void)device_.driver.set_context(device_.context);
  (device_.pool.*room)();
  const AllocationProperties properties = properties_of(device_.device);
  has_handle_ = device_.driver.create_memory(&handle_, bytes_, &properties, 0) == 0;
  return has_handle_;
}

bool ExportedMemory::map() {
  const auto held = device_.tenure.hold();
  if (!held) return false;
  const Driver& driver = device_.driver;
  const AccessDescription access{{kOnDevice, device_.device}, kReadWrite};
  if (driver.export_memory(&fd_, handle_, kDescriptor, 0) != 0) return false;
  if (driver.reserve(&at_, bytes_, 0, 0, 0) != 0) return false;
  is_mapped_ = driver.map(at_, bytes_, 0, handle_, 0) == 0;
  return is_mapped_ && driver.access(at_, bytes_, &access, 1) == 0 && source_->zero(at_, bytes_);
}

/// Jobs left behind may still write there. Mappings and what is mapped belong to no context.
ExportedMemory::~ExportedMemory() {
  const Driver& driver = device_.driver;
  {
    const auto held = device_.tenure.hold();
    (void)driver.set_context(held ? device_.context : nullptr);
    if (held && is_mapped_) (void)driver.wait_for_stream(device_.stream);
  }
  if (is_mapped_) (void)driver.unmap(at_, bytes_);
  if (at_) (void)driver.unreserve(at_, bytes_);
  if (fd_ >= 0) ::close(fd_);
  if (has_handle_) (void)driver.release_memory(handle_);
  if (is_taken_) device_.pool.budget().give_back(bytes_);
}

}  // namespace

Expected<std::shared_ptr<ExportSource>> ExportSource::create(std::shared_ptr<const void> owner,
                                                             const ExportDevice& device) {
  const auto has = [&](Attribute which) {
    int value = 0;
    return device.driver.device_attribute(&value, int(which), device.device) == 0 && value != 0;
  };
  std::shared_ptr<ExportSource> source(new ExportSource(std::move(owner), device));
  const AllocationProperties properties = properties_of(device.device);
  std::size_t step = 0;
  const bool is_able = has(Attribute::kVirtualMemory) && has(Attribute::kDescriptors) &&
                       device.driver.granularity(&step, &properties, kMinimum) == 0 &&
                       std::has_single_bit(step) &&
                       device.driver.device_uuid(source->uuid_.data(), device.device) == 0 &&
                       device.driver.create_stream(&source->stream_, kNonBlocking) == 0 &&
                       device.driver.allocate_pinned(&source->stage_, kStageBytes, 0) == 0 &&
                       std::ranges::all_of(source->come_, [&](EventHandle& event) {
                         return device.driver.create_event(&event, kNoTiming) == 0;
                       });
  if (!is_able)
    return fail(Code::kUnavailable, "backend",
                "this GPU or its driver has no memory that other processes can map");
  source->step_ = step;
  return source;
}

std::shared_ptr<SharedMemory> ExportSource::make(u64 bytes) {
  auto memory = std::make_shared<ExportedMemory>(shared_from_this());
  return memory->open(bytes) ? memory : nullptr;
}

void ExportSource::know(const std::weak_ptr<SharedMemoryKeeper>& keeper) {
  const std::lock_guard lock(keepers_mutex_);
  std::erase_if(keepers_, [&](const auto& each) {
    return each.expired() || (!each.owner_before(keeper) && !keeper.owner_before(each));
  });
  keepers_.push_back(keeper);
}

bool ExportSource::reclaim() {
  std::vector<std::weak_ptr<SharedMemoryKeeper>> keepers;
  {
    const std::lock_guard lock(keepers_mutex_);
    keepers = keepers_;
  }
  for (const auto& each : keepers)
    if (const auto keeper = each.lock(); keeper && keeper->let_go(*this)) return true;
  return false;
}

ExportSource::~ExportSource() {
  const auto held = device_.tenure.hold();
  if (!held) return;  // what it had went with the context
  (void)device_.driver.set_context(device_.context);
  for (EventHandle event : come_)
    if (event) (void)device_.driver.destroy_event(event);
  if (stage_) (void)device_.driver.release_pinned(stage_);
  if (stream_) (void)device_.driver.destroy_stream(stream_);
}

bool ExportSource::zero(DevicePointer at, u64 bytes) {
  const std::lock_guard lock(mutex_);
  return device_.driver.fill(at, 0, bytes, stream_) == 0 &&
         device_.driver.wait_for_stream(stream_) == 0;
}

namespace {

/// Pieces of a stream's copies, as they come. Thread: any; whoever needs the next one first waits
/// for it.
class Arrivals {
 public:
  Arrivals(const ExportDevice& device, std::span<const EventHandle> come)
      : device_(device), come_(come) {}
  /// False when the driver refuses.
  [[nodiscard]] bool wait_for(u32 piece) {
    while (there_ <= piece && result_ == 0) {
      const std::unique_lock lock(mutex_, std::try_to_lock);
      if (!lock)
        std::this_thread::yield();
      else if (there_ <= piece && result_ == 0)
        wait_for_next();
    }
    return result_ == 0;
  }
  [[nodiscard]] Result result() const { return result_; }

 private:
  void wait_for_next() {
    (void)device_.driver.set_context(device_.context);
    result_ = device_.driver.wait_for_event(come_[there_]);
    if (result_ == 0) ++there_;
  }

  const ExportDevice& device_;
  const std::span<const EventHandle> come_;
  std::mutex mutex_;
  std::atomic<u32> there_ = 0;
  std::atomic<Result> result_ = 0;
};

}  // namespace

/// At most as many bytes as the stage has. All threads take what has come while the rest is on its
/// way: to wake them takes as long as the copy.
Result ExportSource::fetch(DevicePointer from, u64 size, const TakePiece& take) const {
  const Driver& driver = device_.driver;
  auto* stage = static_cast<std::byte*>(stage_);
  Result result = 0;
  for (u64 begin = 0; begin < size && result == 0; begin += kPieceBytes) {
    const u64 bytes = std::min(kPieceBytes, size - begin);
    result = driver.download(stage + begin, from + begin, bytes, stream_);
    if (result == 0) result = driver.record_event(come_[begin / kPieceBytes], stream_);
  }
  if (result != 0) return result;
  Arrivals arrivals(device_, come_);
  run_alone([&] {
    parallel_for((size + kShareBytes - 1) / kShareBytes, [&](u64 share) {
      const u64 begin = share * kShareBytes;
      if (arrivals.wait_for(u32(begin / kPieceBytes)))
        take(begin, {stage + begin, std::min(kShareBytes, size - begin)});
    });
  });
  return arrivals.result();
}

Status ExportSource::read(DevicePointer from, u64 size, const TakePiece& take) {
  const auto held = device_.tenure.hold();
  if (!held) return fail(Code::kUnavailable, "", "the GPU was lost with what was written there");
  const std::lock_guard lock(mutex_);
  Result result = device_.driver.set_context(device_.context);
  for (u64 begin = 0; begin < size && result == 0; begin += kStageBytes)
    result = fetch(from + begin, std::min(kStageBytes, size - begin),
                   [&](u64 at, std::span<const std::byte> piece) { take(begin + at, piece); });
  if (result == 0) return {};
  return fail(Code::kUnavailable, "",
              "reading the GPU's memory failed: " + device_.driver.describe(result));
}

/// Behind the numbers on the host is a word that the program sets where it finds something wrong.
Result ExportSource::take(DevicePointer from, const Taking& what, const Twin& to,
                          bool& is_good) const {
  const Driver& driver = device_.driver;
  auto* wrong = reinterpret_cast<u32*>(to.host + what.bytes);
  *wrong = 0;
  TakeLaunch launch{reinterpret_cast<const void*>(from), reinterpret_cast<float*>(to.device),
                    reinterpret_cast<float*>(to.host_there),
                    reinterpret_cast<u32*>(to.host_there + what.bytes), what.count};
  void* arguments[] = {&launch};
  const auto blocks = unsigned((what.count + kTakeThreads - 1) / kTakeThreads);
  Result result =
      driver.launch(what.program, blocks, 1, 1, kTakeThreads, 1, 1, 0, stream_, arguments, nullptr);
  if (result == 0) result = driver.wait_for_stream(stream_);
  is_good = result == 0 && *wrong == 0;
  return result;
}

Expected<BufferPtr> ExportSource::take(DevicePointer from, u64 size, Numbers kind) {
  const bool is_f64 = kind == Numbers::kPosesF64;
  const Taking what = kind == Numbers::kFloats
                          ? Taking{takes_.floats, size / sizeof(float), size}
                          : Taking{is_f64 ? takes_.poses_f64 : takes_.poses,
                                   size / (is_f64 ? sizeof(glm::dmat4) : sizeof(glm::mat4)),
                                   size / (is_f64 ? 2 : 1) / 4 * 3};
  if (!what.program || what.bytes < takes_.fewest) return nullptr;
  auto twin = twins_->take(what.bytes + kWordBytes, stream_);
  if (!twin) return nullptr;
  const auto held = device_.tenure.hold();
  if (!held) return fail(Code::kUnavailable, "", "the GPU was lost with what was written there");
  const std::lock_guard lock(mutex_);
  bool is_good = false;
  Result result = device_.driver.set_context(device_.context);
  if (result == 0) result = take(from, what, *twin, is_good);
  if (result != 0)
    return fail(Code::kUnavailable, "",
                "reading the GPU's memory failed: " + device_.driver.describe(result));
  if (!is_good) return nullptr;
  const std::span bytes(twin->host, what.bytes);
  return std::make_shared<const Buffer>(std::move(twin), bytes, Buffer::Kind::kPooled);
}

}  // namespace heliograph::cuda
