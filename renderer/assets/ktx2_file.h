// The parts of a KTX 2 file, every range checked. Used by picture_ktx2.cpp.
// Source: Khronos, KTX File Format Specification 2.0, 3; Khronos Data Format Specification 1.3, 5.
#pragma once

#include <map>
#include <string>

#include "renderer/assets/picture.h"

namespace heliograph::assets {

/// Ways of packing a level.
enum class Ktx2Scheme : u32 { kNone = 0, kBasisLz = 1, kZstandard = 2, kZlib = 3 };

/// Kind of a level's texels, by the names of the Khronos Data Format Specification.
struct Ktx2Format {
  enum class Transfer : u8 { kUnspecified = 0, kLinear = 1, kSrgb = 2 };
  u8 primaries = 0;
  Transfer transfer = Transfer::kUnspecified;
  bool premultiplied = false;
};

/// Borrows the file.
struct Ktx2File {
  u32 vk_format = 0;  // VkFormat; 0: the descriptor gives it
  u32 width = 0, height = 0, depth = 0, layers = 0, faces = 0;
  Ktx2Scheme scheme = Ktx2Scheme::kNone;
  Bytes level;             // the largest
  u64 unpacked_bytes = 0;  // of it, once it is not packed any more; 0 for Basis LZ
  Ktx2Format format;
  std::map<std::string, std::string, std::less<>> values;  // KTXorientation: "rd"
};

[[nodiscard]] Ktx2File read_ktx2(const PictureSource& source);

}  // namespace heliograph::assets
