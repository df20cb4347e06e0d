// Pictures to texels: PNG, JPEG, EXR, Radiance HDR, TIFF, and nothing else. Called by image.cpp for
// lone pictures and by the model loaders for textures.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "renderer/assets/budget.h"
#include "renderer/scene/components.h"

namespace heliograph::assets {

using Bytes = std::span<const std::byte>;

enum class PictureFormat : u8 { kNone, kPng, kJpeg, kExr, kHdr, kTiff };

/// By the first bytes.
[[nodiscard]] PictureFormat picture_format(Bytes bytes);
/// By a file's extension ("png") or a media type ("image/png").
[[nodiscard]] PictureFormat picture_format(std::string_view name);

struct Picture {
  ImageData image;
  bool srgb = false;
  std::vector<std::string> warnings;
};

/// Decodes a picture whose content and whose name say the same allowed format.
///
/// name   a file's path, or a media type
/// where  for messages
/// Size and total are checked before anything is allocated. Non-finite texels become 0, with a
/// warning that counts them. Texels stay as stored: alpha straight or premultiplied as in the file,
/// no gamma; 1, 2, 4 bits and palettes become 8 bits, other primaries than Rec.709 are converted.
[[nodiscard]] Picture decode_picture(Bytes bytes, std::string_view name, const std::string& where,
                                     Budget& budget);

/// The input of one codec.
struct PictureSource {
  Bytes bytes;
  const std::string& where;
  Budget& budget;
};
[[nodiscard]] Picture decode_png(const PictureSource& source);
[[nodiscard]] Picture decode_jpeg(const PictureSource& source);
[[nodiscard]] Picture decode_exr(const PictureSource& source);
[[nodiscard]] Picture decode_hdr(const PictureSource& source);
[[nodiscard]] Picture decode_tiff(const PictureSource& source);
/// Of an LM-63 file, for a light's profile.
[[nodiscard]] Picture decode_ies(const PictureSource& source);

/// A picture being filled: storage for width * height * channels texels, zeroed, after the limits
/// were asked.
struct Canvas {
  ImageData image;
  std::vector<std::byte> texels;

  Canvas(const ImageData& layout, const PictureSource& source);
  [[nodiscard]] std::size_t row_bytes() const { return texels.size() / image.height; }
  [[nodiscard]] std::byte* row(u32 y) { return texels.data() + y * row_bytes(); }
  [[nodiscard]] Picture finish(bool srgb) &&;
};

[[nodiscard]] constexpr u32 texel_bytes(TexelType type) {
  return type == TexelType::kU8 ? 1 : type == TexelType::kF32 ? 4 : 2;
}

}  // namespace heliograph::assets
