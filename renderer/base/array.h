// Immutable arrays with shared ownership: the payload of meshes and textures.
#pragma once

#include <atomic>
#include <cassert>
#include <cstddef>
#include <cstring>
#include <memory>
#include <span>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph {

/// Immutable bytes: an upload, a mapped result of the decoder, or a vector that was moved in.
///
/// Owns: the bytes, through `owner`. Thread: any. `serial` is unique in the process and names the
/// content: equal serials mean equal bytes, so derived data is cached by it.
class Buffer {
 public:
  /// Kinds of memory. kPooled: of a pool of bounded size, so that who needs a part may hold all.
  enum class Kind : u8 { kAny, kPooled };
  Buffer(std::shared_ptr<const void> owner, std::span<const std::byte> bytes,
         Kind kind = Kind::kAny)
      : owner_(std::move(owner)), bytes_(bytes), serial_(next_serial()), kind_(kind) {}

  [[nodiscard]] std::span<const std::byte> bytes() const { return bytes_; }
  [[nodiscard]] u64 serial() const { return serial_; }
  [[nodiscard]] Kind kind() const { return kind_; }

 private:
  static u64 next_serial() {
    static std::atomic<u64> last{0};
    return ++last;
  }
  std::shared_ptr<const void> owner_;
  std::span<const std::byte> bytes_;
  u64 serial_;
  Kind kind_;
};

using BufferPtr = std::shared_ptr<const Buffer>;

/// A typed view of a whole Buffer; empty when there is none. Cheap to copy.
template <class T>
class ArrayOf {
 public:
  ArrayOf() = default;
  explicit ArrayOf(BufferPtr buffer) : buffer_(std::move(buffer)) {
    assert(!buffer_ || buffer_->bytes().size() % sizeof(T) == 0);
    assert(!buffer_ || reinterpret_cast<std::uintptr_t>(buffer_->bytes().data()) % alignof(T) == 0);
  }
  /// Takes the vector's storage.
  explicit ArrayOf(std::vector<T> values) {
    if (values.empty()) return;
    auto owner = std::make_shared<const std::vector<T>>(std::move(values));
    buffer_ = std::make_shared<const Buffer>(owner, std::as_bytes(std::span(*owner)));
  }

  [[nodiscard]] const T* data() const {
    return buffer_ ? reinterpret_cast<const T*>(buffer_->bytes().data()) : nullptr;
  }
  [[nodiscard]] std::size_t size() const {
    return buffer_ ? buffer_->bytes().size() / sizeof(T) : 0;
  }
  [[nodiscard]] bool empty() const { return size() == 0; }
  [[nodiscard]] std::span<const T> span() const { return {data(), size()}; }
  [[nodiscard]] const T& operator[](std::size_t i) const { return data()[i]; }
  [[nodiscard]] const T* begin() const { return data(); }
  [[nodiscard]] const T* end() const { return data() + size(); }
  [[nodiscard]] u64 serial() const { return buffer_ ? buffer_->serial() : 0; }
  [[nodiscard]] const BufferPtr& buffer() const { return buffer_; }

 private:
  BufferPtr buffer_;
};

}  // namespace heliograph
