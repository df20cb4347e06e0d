// Device memory that other processes map by a descriptor. Given out by the backend.
#pragma once

#include <array>
#include <mutex>
#include <vector>

#include "renderer/backend/cuda/twins.h"
#include "renderer/frame/lent_memory.h"

namespace heliograph::cuda {

/// Kinds that a device takes, by the programs of take.cu; null: nothing.
struct Takes {
  FunctionHandle floats = nullptr, poses = nullptr, poses_f64 = nullptr;
  u64 fewest = 1 << 20;  // bytes; fewer are on the host sooner
};

/// Allocations of the driver's virtual memory management, each with a POSIX descriptor. A process
/// that imports one maps the same memory, for as long as it likes. They lie beside the device's
/// pool, in its budget. Thread: any. Owns: a stream of its own, so that nothing here waits for what
/// renders, and pinned memory.
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
  /// Numbers as the device takes them, there and on the host; null as LentMemory::take() has it.
  [[nodiscard]] Expected<BufferPtr> take(DevicePointer from, u64 size, Numbers kind);
  /// Before anything is made.
  void set_takes(const Takes& takes, std::shared_ptr<Twins> twins) {
    takes_ = takes;
    twins_ = std::move(twins);
  }
  /// The same of zeros, while the caller holds the tenure; false when the driver refuses.
  [[nodiscard]] bool zero(DevicePointer at, u64 bytes);

 private:
  ExportSource(std::shared_ptr<const void> owner, const ExportDevice& device)
      : owner_(std::move(owner)), device_(device) {}
  // Under mutex_:
  [[nodiscard]] Result fetch(DevicePointer from, u64 size, const TakePiece& take) const;
  struct Taking {
    FunctionHandle program;
    u64 count, bytes;  // of what the program makes
  };
  [[nodiscard]] Result take(DevicePointer from, const Taking& what, const Twin& to,
                            bool& is_good) const;

  const std::shared_ptr<const void> owner_;
  const ExportDevice device_;
  DeviceUuid uuid_{};
  u64 step_ = 0;
  std::mutex mutex_;  // of the stream and what it writes to
  StreamHandle stream_ = nullptr;
  void* stage_ = nullptr;  // kPieces pieces
  Takes takes_;
  std::shared_ptr<Twins> twins_;
  std::array<EventHandle, kPieces> come_{};
  std::mutex keepers_mutex_;
  std::vector<std::weak_ptr<SharedMemoryKeeper>> keepers_;
};

}  // namespace heliograph::cuda
