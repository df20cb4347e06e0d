// Memory of a frame's planes: the heap's, or its reader's, of the host or of a device.
#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <span>

#include "kernels/scene/planes.h"
#include "renderer/base/types.h"

namespace heliograph {

/// Memory of one plane, aligned for any use of it. Goes back to where it came from when nobody
/// holds it.
class PixelMemory {
 public:
  virtual ~PixelMemory() = default;
  [[nodiscard]] virtual std::span<std::byte> bytes() = 0;
  /// The addresses are a device's: the host cannot read there.
  [[nodiscard]] virtual bool is_on_device() const { return false; }
};

/// Makes at least so many bytes for a plane, not initialised; null when there are none. Thread:
/// any.
using PixelAllocator = std::function<std::shared_ptr<PixelMemory>(kernels::Plane plane, u64 bytes)>;

/// The pixels of a plane, row-major, row 0 at the top.
class Pixels {
 public:
  Pixels() = default;
  /// Not initialised. From `allocator`, or from the heap when that is absent or has none.
  Pixels(kernels::Plane plane, u64 bytes, const PixelAllocator& allocator);
  /// In memory that somebody made.
  Pixels(u64 bytes, std::shared_ptr<PixelMemory> memory)
      : memory_(std::move(memory)), bytes_(memory_->bytes().first(bytes)) {}

  [[nodiscard]] std::byte* data() { return bytes_.data(); }
  [[nodiscard]] const std::byte* data() const { return bytes_.data(); }
  [[nodiscard]] std::size_t size() const { return bytes_.size(); }
  [[nodiscard]] PixelMemory* memory() const { return memory_.get(); }

  friend bool operator==(const Pixels& a, const Pixels& b) {
    return std::ranges::equal(a.bytes_, b.bytes_);
  }

 private:
  std::shared_ptr<PixelMemory> memory_;
  std::span<std::byte> bytes_;
};

}  // namespace heliograph
