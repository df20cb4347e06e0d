// Host memory that another process maps. Used for arenas of frames, and for long replies to quick
// calls.
#pragma once

#include <memory>
#include <span>

#include "renderer/frame/shared_memory.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// A memfd that this process writes and its peer only reads. The kernel allocates pages on first
/// write: untouched pages cost nothing.
class SealedMemory final : public SharedMemory {
 public:
  /// Creates a memfd of this size; null when the kernel refuses.
  [[nodiscard]] static std::shared_ptr<SealedMemory> create(u64 bytes);
  ~SealedMemory() override;

  /// Returns the descriptor, sealed: the size is final, and no peer can map it for writing.
  [[nodiscard]] int fd() const override { return fd_.get(); }
  [[nodiscard]] std::span<std::byte> bytes() const override { return bytes_; }
  [[nodiscard]] const DeviceUuid* device() const override { return nullptr; }

 private:
  SealedMemory(UniqueFd fd, std::span<std::byte> bytes) : fd_(std::move(fd)), bytes_(bytes) {}

  const UniqueFd fd_;
  const std::span<std::byte> bytes_;
};

}  // namespace heliograph::server
