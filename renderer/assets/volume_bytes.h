// Bounds-checked reading of volume files. Used by the readers of .nvdb and .vdb.
#pragma once

#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "renderer/assets/refuse.h"
#include "renderer/base/types.h"

namespace heliograph::assets {

/// A file, or a part of one, read from the front; refuses whatever leaves it.
class Cursor {
 public:
  explicit Cursor(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <class T>
  T take() {
    T value;
    std::memcpy(&value, skip(sizeof(T)), sizeof(T));
    return value;
  }
  const std::byte* skip(u64 count) {
    if (count > bytes_.size() - at_) refuse("header", "the file is truncated");
    at_ += count;
    return bytes_.data() + at_ - count;
  }
  std::span<const std::byte> span(u64 count) { return {skip(count), count}; }
  void seek(u64 to) {
    if (to > bytes_.size()) refuse("header", "a grid leaves the file");
    at_ = to;
  }
  std::string text(u64 length) {
    constexpr u64 kLongest = 1 << 16;
    if (length > kLongest) refuse("header", "a name is too long");
    return {reinterpret_cast<const char*>(skip(length)), length};
  }
  /// 32 bits of length, then the characters.
  std::string text() { return text(take<u32>()); }

 private:
  std::span<const std::byte> bytes_;
  u64 at_ = 0;
};

/// A range of the bytes.
inline std::span<const std::byte> part_of(std::span<const std::byte> bytes, u64 offset, u64 size) {
  if (offset > bytes.size() || size > bytes.size() - offset)
    refuse("nodes", "a node leaves the file");
  return bytes.subspan(offset, size);
}
/// The T at an offset.
template <class T>
T read_at(std::span<const std::byte> bytes, u64 offset) {
  T value;
  std::memcpy(&value, part_of(bytes, offset, sizeof(T)).data(), sizeof(T));
  return value;
}

inline bool bit_at(std::span<const std::byte> mask, u32 bit) {
  return ((std::to_integer<u32>(mask[bit / 8]) >> (bit % 8)) & 1) != 0;
}

/// zlib data of so many bytes when it is unpacked. Refuses anything else.
[[nodiscard]] std::vector<std::byte> inflate(std::span<const std::byte> packed, u64 size);

}  // namespace heliograph::assets
