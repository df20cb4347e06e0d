// Shared memory that the other process writes too. Of devices: the host's is sealed against that.
#pragma once

#include <functional>
#include <span>

#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "renderer/frame/shared_memory.h"

namespace heliograph {

/// Takes bytes by pieces, from several threads and in any order: where a piece begins, and what is
/// gone when it returns.
using TakePiece = std::function<void(u64 begin, std::span<const std::byte> piece)>;

/// Kinds of numbers that a device is to make, and to find right.
enum class Numbers : u8 {
  kFloats,    // f32 as they are: finite
  kPoses,     // row-major 4x4 matrices to mat4x3: take_affine() and plainly_invertible()
  kPosesF64,  // the same of f64
};

class LentMemory : public SharedMemory {
 public:
  /// Brings to the host what the other process has written and seen to the end of. Waits.
  /// UNAVAILABLE when the device is lost. Thread: any.
  ///
  /// offset   bytes from the start; offset + size is at most the memory's
  /// take     pieces count from there, and all but the last are a multiple of 256 bytes
  [[nodiscard]] virtual Status read(u64 offset, u64 size, const TakePiece& take) const = 0;
  /// The same numbers, checked and converted by the device, which keeps a copy while the result is
  /// held: no thread of the host reads them. Null where it cannot, or finds something wrong: then
  /// read() them.
  ///
  /// size   of whole numbers or matrices
  [[nodiscard]] virtual Expected<BufferPtr> take(u64 /*offset*/, u64 /*size*/, Numbers) const {
    return nullptr;
  }
};

}  // namespace heliograph
