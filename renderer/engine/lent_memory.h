// Shared memory that the other process writes too. Of devices: the host's is sealed against that.
#pragma once

#include "renderer/base/error.h"
#include "renderer/engine/shared_memory.h"

namespace heliograph {

class LentMemory : public SharedMemory {
 public:
  /// Copies to the host what the other process has written and seen to the end of. Waits.
  /// UNAVAILABLE when the device is lost. Thread: any.
  ///
  /// offset   bytes from the start; offset + to.size() is at most the size
  [[nodiscard]] virtual Status read(u64 offset, std::span<std::byte> to) const = 0;
};

}  // namespace heliograph
