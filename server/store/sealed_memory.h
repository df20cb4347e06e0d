// Pages of the host that another process maps. Used for arenas of frames, and for long replies to
// quick calls.
#pragma once

#include <memory>
#include <span>

#include "renderer/frame/shared_memory.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// Pages of a memfd that this process writes and its peer only reads. The kernel finds them when
/// they are first written: what was not costs nothing.
class SealedMemory final : public SharedMemory {
 public:
  /// Null when the kernel has no more.
  [[nodiscard]] static std::shared_ptr<SealedMemory> create(u64 bytes);
  ~SealedMemory() override;

  /// Sealed: its size is final, and nobody else can map it for writing.
  [[nodiscard]] int fd() const override { return fd_.get(); }
  [[nodiscard]] std::span<std::byte> bytes() const override { return bytes_; }
  [[nodiscard]] const DeviceUuid* device() const override { return nullptr; }

 private:
  SealedMemory(UniqueFd fd, std::span<std::byte> bytes) : fd_(std::move(fd)), bytes_(bytes) {}

  const UniqueFd fd_;
  const std::span<std::byte> bytes_;
};

}  // namespace heliograph::server
