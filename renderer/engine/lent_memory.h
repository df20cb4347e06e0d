// Shared memory that the other process writes too. Of devices: the host's is sealed against that.
#pragma once

#include <functional>
#include <span>

#include "renderer/base/error.h"
#include "renderer/engine/shared_memory.h"

namespace heliograph {

/// Takes bytes by pieces, from several threads and in any order: where a piece begins, and what is
/// gone when it returns.
using TakePiece = std::function<void(u64 begin, std::span<const std::byte> piece)>;

class LentMemory : public SharedMemory {
 public:
  /// Brings to the host what the other process has written and seen to the end of. Waits.
  /// UNAVAILABLE when the device is lost. Thread: any.
  ///
  /// offset   bytes from the start; offset + size is at most the memory's
  /// take     pieces count from there, and all but the last are a multiple of 256 bytes
  [[nodiscard]] virtual Status read(u64 offset, u64 size, const TakePiece& take) const = 0;
};

}  // namespace heliograph
