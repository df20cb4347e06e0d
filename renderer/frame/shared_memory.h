// Memory that another process maps by a descriptor: pages of the host, or a device's.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <span>

#include "renderer/base/types.h"

namespace heliograph {

/// Identifier of a GPU, as its driver names it.
using DeviceUuid = std::array<u8, 16>;

/// Owns: a descriptor and a mapping. What another process has mapped outlives it. Thread: any.
class SharedMemory {
 public:
  SharedMemory() = default;
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;
  virtual ~SharedMemory() = default;

  /// Descriptor that the other process is given. It stays this object's.
  [[nodiscard]] virtual int fd() const = 0;
  /// Place of the memory: addresses of the host, or the device's, which the host cannot follow.
  [[nodiscard]] virtual std::span<std::byte> bytes() const = 0;
  /// Device whose memory it is; null: the host's.
  [[nodiscard]] virtual const DeviceUuid* device() const = 0;
};

class SharedMemorySource;

/// Keeper of some of such memory for later. Thread: any.
class SharedMemoryKeeper {
 public:
  SharedMemoryKeeper() = default;
  SharedMemoryKeeper(const SharedMemoryKeeper&) = delete;
  SharedMemoryKeeper& operator=(const SharedMemoryKeeper&) = delete;
  virtual ~SharedMemoryKeeper() = default;

  /// Lets go of what it keeps of a source and nobody uses. False when there is none, or when it
  /// cannot know now: it never waits.
  virtual bool let_go(const SharedMemorySource& source) = 0;
};

/// Makes such memory, of one kind. Thread: as whoever gives it out states.
class SharedMemorySource {
 public:
  SharedMemorySource() = default;
  SharedMemorySource(const SharedMemorySource&) = delete;
  SharedMemorySource& operator=(const SharedMemorySource&) = delete;
  virtual ~SharedMemorySource() = default;

  /// Zeroed, so that it shows nothing of who had it before; null when there is no more.
  ///
  /// bytes   a multiple of step()
  [[nodiscard]] virtual std::shared_ptr<SharedMemory> make(u64 bytes) = 0;
  /// The keeper is asked to let go when other uses of the same memory find no more.
  virtual void know(const std::weak_ptr<SharedMemoryKeeper>& keeper) = 0;
  /// Bytes, a power of two.
  [[nodiscard]] virtual u64 step() const = 0;
  /// Device whose memory it makes; null: the host's.
  [[nodiscard]] virtual const DeviceUuid* device() const = 0;
};

}  // namespace heliograph
