#include "renderer/backend/cuda/exports.h"

#include <unistd.h>

#include <bit>

namespace heliograph::cuda {
namespace {

constexpr int kPinned = 1;      // CU_MEM_ALLOCATION_TYPE_PINNED
constexpr int kDescriptor = 1;  // CU_MEM_HANDLE_TYPE_POSIX_FILE_DESCRIPTOR
constexpr int kOnDevice = 1;    // CU_MEM_LOCATION_TYPE_DEVICE
constexpr int kReadWrite = 3;   // CU_MEM_ACCESS_FLAGS_PROT_READWRITE
constexpr int kMinimum = 0;     // CU_MEM_ALLOC_GRANULARITY_MINIMUM

AllocationProperties properties_of(Device device) {
  return {.kind = kPinned, .handle_kinds = kDescriptor, .location = {kOnDevice, device}};
}

class ExportedMemory final : public SharedMemory {
 public:
  ExportedMemory(std::shared_ptr<const void> owner, const ExportDevice& device,
                 const DeviceUuid& uuid)
      : owner_(std::move(owner)), device_(device), uuid_(uuid) {}
  ~ExportedMemory() override;

  /// False when the driver refuses.
  [[nodiscard]] bool open(u64 bytes);
  [[nodiscard]] int fd() const override { return fd_; }
  [[nodiscard]] std::span<std::byte> bytes() const override {
    return {reinterpret_cast<std::byte*>(at_), bytes_};
  }
  [[nodiscard]] const DeviceUuid* device() const override { return &uuid_; }

 private:
  [[nodiscard]] bool create();
  [[nodiscard]] bool map();

  const std::shared_ptr<const void> owner_;
  const ExportDevice device_;
  const DeviceUuid uuid_;
  u64 bytes_ = 0;
  MemoryHandle handle_ = 0;
  bool has_handle_ = false, is_mapped_ = false;
  int fd_ = -1;
  DevicePointer at_ = 0;
};

bool ExportedMemory::open(u64 bytes) {
  bytes_ = bytes;
  (void)device_.driver.set_context(device_.context);
  if (!create()) {
    (void)device_.driver.wait_for_stream(device_.stream);
    (void)device_.driver.trim_pool(device_.pool, 0);
    if (!create()) return false;
  }
  return map();
}

bool ExportedMemory::create() {
  const AllocationProperties properties = properties_of(device_.device);
  has_handle_ = device_.driver.create_memory(&handle_, bytes_, &properties, 0) == 0;
  return has_handle_;
}

bool ExportedMemory::map() {
  const Driver& driver = device_.driver;
  const AccessDescription access{{kOnDevice, device_.device}, kReadWrite};
  if (driver.export_memory(&fd_, handle_, kDescriptor, 0) != 0) return false;
  if (driver.reserve(&at_, bytes_, 0, 0, 0) != 0) return false;
  is_mapped_ = driver.map(at_, bytes_, 0, handle_, 0) == 0;
  return is_mapped_ && driver.access(at_, bytes_, &access, 1) == 0 &&
         driver.fill(at_, 0, bytes_, device_.stream) == 0 &&
         driver.wait_for_stream(device_.stream) == 0;
}

/// What a job left behind may still write there.
ExportedMemory::~ExportedMemory() {
  const Driver& driver = device_.driver;
  (void)driver.set_context(device_.context);
  if (is_mapped_) {
    (void)driver.wait_for_stream(device_.stream);
    (void)driver.unmap(at_, bytes_);
  }
  if (at_) (void)driver.unreserve(at_, bytes_);
  if (fd_ >= 0) ::close(fd_);
  if (has_handle_) (void)driver.release_memory(handle_);
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
                       device.driver.device_uuid(source->uuid_.data(), device.device) == 0;
  if (!is_able)
    return fail(Code::kUnavailable, "backend",
                "this GPU or its driver has no memory that other processes can map");
  source->step_ = step;
  return source;
}

std::shared_ptr<SharedMemory> ExportSource::make(u64 bytes) {
  auto memory = std::make_shared<ExportedMemory>(owner_, device_, uuid_);
  return memory->open(bytes) ? memory : nullptr;
}

}  // namespace heliograph::cuda
