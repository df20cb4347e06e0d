// Pictures to texels, by OpenImageIO. Called by load.cpp for lone pictures and by the model loaders
// for textures.
#pragma once

#include <cstdlib>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "renderer/assets/budget.h"
#include "renderer/scene/components.h"

namespace heliograph::assets {

using Bytes = std::span<const std::byte>;

/// By its content.
[[nodiscard]] bool is_picture(Bytes bytes);
/// By a file's extension ("png") or a media type ("image/png").
[[nodiscard]] bool is_picture_name(std::string_view name);
/// "png, jpeg, ..."
[[nodiscard]] std::string picture_formats();

struct Picture {
  ImageData image;
  bool srgb = false;
  std::vector<std::string> warnings;
};

/// Decodes the first picture of a file, at its full resolution. The content decides what the format
/// is; a name of another one is a warning.
///
/// name   a file's extension, or a media type
/// where  for messages
/// layer  of a file with several: its name, that of a part, or of a channel; "": the colours
///
/// Rows run from the top, as the file's orientation has it. Alpha is straight: colours that were
/// multiplied by it are divided. 8 and 16 bits, halves and floats stay, other numbers become floats
/// (integers of full range 1); palettes, CMYK and 1 to 7 bits become 8 bits of grey or RGB.
/// Infinite texels become the largest finite value and NaN 0, other primaries Rec.709's, each with
/// a warning. Size and total are checked before texels are allocated.
[[nodiscard]] Picture decode_picture(Bytes bytes, std::string_view name, const std::string& where,
                                     Budget& budget, std::string_view layer = {});

/// A file that becomes a picture.
struct PictureSource {
  Bytes bytes;
  const std::string& where;
  Budget& budget;
};
/// Decodes an LM-63 file, for a light's profile.
[[nodiscard]] Picture decode_ies(const PictureSource& source);

/// A picture being filled: storage for width * height * channels texels, zeroed, after the limits
/// were asked.
struct Canvas {
  ImageData image;
  std::span<std::byte> texels;

  Canvas(const ImageData& layout, const PictureSource& source);
  [[nodiscard]] std::size_t texel_size() const;
  [[nodiscard]] std::size_t row_bytes() const { return texels.size() / image.height; }
  [[nodiscard]] std::byte* row(u32 y) { return texels.data() + y * row_bytes(); }
  /// Makes every texel finite.
  [[nodiscard]] Picture finish(bool srgb) &&;

 private:
  struct Free {
    void operator()(std::byte* bytes) const { std::free(bytes); }
  };
  /// Memory of calloc(): large blocks are new pages, which are zeros before anybody writes them.
  std::unique_ptr<std::byte, Free> owner_;
};

[[nodiscard]] constexpr u32 component_bytes(TexelType type) {
  return type == TexelType::kU8 ? 1 : type == TexelType::kF32 ? 4 : 2;
}

}  // namespace heliograph::assets
