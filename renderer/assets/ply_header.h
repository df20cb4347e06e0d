// The header of a PLY file and the numbers behind it. Used by ply.cpp.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph::assets::ply {

enum class Type : u8 { kI8, kU8, kI16, kU16, kI32, kU32, kF32, kF64 };

struct Property {
  std::string name;
  Type type = Type::kF32;
  std::optional<Type> count;  // of a list
};
struct Element {
  std::string name;
  u64 count = 0;
  std::vector<Property> properties;
};

enum class Encoding : u8 { kAscii, kLittle, kBig };

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
  std::vector<std::string> textures;  // of "comment TextureFile <name>"
  std::vector<std::string> unread;    // words that begin a line and mean nothing
  std::size_t size = 0;
};

/// Refuses what is no PLY header.
[[nodiscard]] Header read_header(std::string_view text);

/// The numbers after the header, one by one.
class Numbers {
 public:
  Numbers(std::string_view rest, Encoding encoding) : rest_(rest), encoding_(encoding) {}

  /// NaN for what a program wrote for a number that is none.
  double next(Type type);
  u64 next_count(Type type);
  /// Leaves out what an ASCII line has beyond its element; whether there was any.
  bool end_element();
  /// True if `count` more of at least `bytes` each can be there.
  [[nodiscard]] bool has(u64 count, u64 bytes) const {
    return count <= rest_.size() / (bytes > 1 ? bytes : 1);
  }

 private:
  double ascii();
  std::string_view rest_;
  Encoding encoding_;
};

}  // namespace heliograph::assets::ply
