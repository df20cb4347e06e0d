// See pixels.h.
#include "renderer/frame/pixels.h"

namespace heliograph {
namespace {

class HeapMemory final : public PixelMemory {
 public:
  explicit HeapMemory(u64 bytes)
      : bytes_(std::make_unique_for_overwrite<std::byte[]>(bytes)), size_(bytes) {}
  [[nodiscard]] std::span<std::byte> bytes() override { return {bytes_.get(), size_}; }

 private:
  const std::unique_ptr<std::byte[]> bytes_;
  const u64 size_;
};

}  // namespace

Pixels::Pixels(kernels::Plane plane, u64 bytes, const PixelAllocator& allocator) {
  if (allocator) memory_ = allocator(plane, bytes);
  if (!memory_) memory_ = std::make_shared<HeapMemory>(bytes);
  bytes_ = memory_->bytes().first(bytes);
}

}  // namespace heliograph
