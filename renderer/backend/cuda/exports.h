// Device memory that other processes map by a descriptor. Given out by the backend.
#pragma once

#include <array>
#include <mutex>
#include <vector>

#include "renderer/backend/cuda/pool.h"
#include "renderer/backend/cuda/tenure.h"
#include "renderer/engine/lent_memory.h"

namespace heliograph::cuda {

/// The device as exports use it.
struct ExportDevice {
  const Driver& driver;
  Pool& pool;  // exports lie beside it, in its budget
  Tenure& tenure;
  Device device = 0;
  ContextHandle context = nullptr;
  StreamHandle stream = nullptr;
};

/// Allocations of the driver's virtual memory management, each with a POSIX descriptor. A process
/// that imports one maps the same memory, for as long as it likes.
/// Thread: any. Owns: a stream of its own, so that nothing here waits for what renders, and pinned
/// memory.
class ExportSource final : public SharedMemorySource,
                           public std::enable_shared_from_this<ExportSource> {
 public:
  /// UNAVAILABLE where the device has no such memory.
  ///
  /// owner   keeps the device alive
  [[nodiscard]] static Expected<std::shared_ptr<ExportSource>> create(
      std::shared_ptr<const void> owner, const ExportDevice& device);

  ~ExportSource() override;

  static constexpr u32 kPieces = 4;

  [[nodiscard]] std::shared_ptr<SharedMemory> make(u64 bytes) override;
  void know(const std::weak_ptr<SharedMemoryKeeper>& keeper) override;
  /// Asks those that know() named; true when one let go of something.
  bool reclaim();
  [[nodiscard]] u64 step() const override { return step_; }
  [[nodiscard]] const DeviceUuid* device() const override { return &uuid_; }
  [[nodiscard]] const ExportDevice& parts() const { return device_; }
  /// Waits for the copy, not for what renders meanwhile. UNAVAILABLE.
  [[nodiscard]] Status read(DevicePointer from, u64 size, const TakePiece& take);
  /// The same of zeros, while the caller holds the tenure; false when the driver refuses.
  [[nodiscard]] bool zero(DevicePointer at, u64 bytes);

 private:
  ExportSource(std::shared_ptr<const void> owner, const ExportDevice& device)
      : owner_(std::move(owner)), device_(device) {}
  // Under mutex_:
  [[nodiscard]] Result fetch(DevicePointer from, u64 size, const TakePiece& take) const;

  const std::shared_ptr<const void> owner_;
  const ExportDevice device_;
  DeviceUuid uuid_{};
  u64 step_ = 0;
  std::mutex mutex_;  // of the stream and what it writes to
  StreamHandle stream_ = nullptr;
  void* stage_ = nullptr;  // kPieces pieces
  std::array<EventHandle, kPieces> come_{};
  std::mutex keepers_mutex_;
  std::vector<std::weak_ptr<SharedMemoryKeeper>> keepers_;
};

}  // namespace heliograph::cuda
