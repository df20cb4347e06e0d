#include "renderer/assets/picture_ktx2.h"

#include <basisu_transcoder.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#include "renderer/assets/bundle.h"
#include "renderer/assets/ktx2_file.h"
#include "renderer/assets/picture_layers.h"
#include "renderer/assets/picture_texels.h"
#include "renderer/assets/refuse.h"

namespace heliograph::assets {
namespace {

using Names = std::vector<std::string>;  // of the channels, as they lie in a texel

/// Texels that are plain, by their VkFormat; that of sRGB has the same ones.
struct Plain {
  u32 format, srgb;
  TexelType type;
  const char* channels;
};
constexpr std::array kPlain = std::to_array<Plain>({
    {9, 15, TexelType::kU8, "R"},
    {16, 22, TexelType::kU8, "RG"},
    {23, 29, TexelType::kU8, "RGB"},
    {30, 36, TexelType::kU8, "BGR"},
    {37, 43, TexelType::kU8, "RGBA"},
    {44, 50, TexelType::kU8, "BGRA"},
    {70, 70, TexelType::kU16, "R"},
    {77, 77, TexelType::kU16, "RG"},
    {84, 84, TexelType::kU16, "RGB"},
    {91, 91, TexelType::kU16, "RGBA"},
    {76, 76, TexelType::kF16, "R"},
    {83, 83, TexelType::kF16, "RG"},
    {90, 90, TexelType::kF16, "RGB"},
    {97, 97, TexelType::kF16, "RGBA"},
    {100, 100, TexelType::kF32, "R"},
    {103, 103, TexelType::kF32, "RG"},
    {106, 106, TexelType::kF32, "RGB"},
    {109, 109, TexelType::kF32, "RGBA"},
});

const Plain* plain_of(u32 vk_format) {
  const auto* found = std::ranges::find_if(kPlain, [&](const Plain& plain) {
    return plain.format == vk_format || plain.srgb == vk_format;
  });
  return found == kPlain.end() ? nullptr : found;
}

struct Texels {
  Canvas canvas;
  Names names;
};

[[noreturn]] void refuse_broken(const PictureSource& source, const std::string& why) {
  refuse(source.where, "broken KTX2: " + why);
}

void check_shape(const Ktx2File& file, const std::string& where) {
  if (file.faces > 1) {
    refuse_unimplemented(where, "a cube map; save it as latitude and longitude");
  }
  if (file.layers > 0) refuse_unimplemented(where, "an array of textures; save one of them");
  if (file.depth > 0) refuse_unimplemented(where, "a picture of volume; save a slice");
  if (file.height == 0) refuse_unimplemented(where, "a texture of one dimension; give it a height");
}

// ---------------------------------------------------------------- plain texels

void unpack(const Ktx2File& file, std::span<std::byte> texels, const PictureSource& source) {
  const u64 size = texels.size();
  if (file.scheme == Ktx2Scheme::kNone && file.level.size() >= size) {
    std::memcpy(texels.data(), file.level.data(), size);
    return;
  }
  auto* to = reinterpret_cast<Bytef*>(texels.data());
  const auto* from = reinterpret_cast<const Bytef*>(file.level.data());
  uLongf read = 0;
  if (file.scheme == Ktx2Scheme::kZstandard) {
    read = ZSTD_decompress(to, size, from, file.level.size());
  }
  if (file.scheme == Ktx2Scheme::kZlib) {
    read = size;
    if (uncompress(to, &read, from, file.level.size()) != Z_OK) read = 0;
  }
  if (read != size) refuse_broken(source, "its level does not hold its texels");
}

/// Luminance is R, and its alpha G, for writers that state so by KTXswizzle.
Names names_of(const Plain& plain, const Ktx2File& file, const std::string& where) {
  const auto found = file.values.find("KTXswizzle");
  const std::string swizzle = found == file.values.end() ? "" : found->second;
  const std::string channels = plain.channels;
  if (channels == "R" && swizzle == "rrr1") return {"Y"};
  if (channels == "RG" && swizzle == "rrrg") return {"Y", "A"};
  if (!swizzle.empty() && swizzle != "rgba" && (swizzle != "rgb1" || channels.size() == 4)) {
    refuse_unimplemented(where, fmt::format("KTXswizzle '{}'; save the channels in their order",
                                            clean_name(swizzle, "?")));
  }
  Names names;
  for (const char channel : channels) names.emplace_back(1, channel);
  return names;
}

Texels plain_texels(const Plain& plain, const Ktx2File& file, const PictureSource& source) {
  Names names = names_of(plain, file, source.where);
  Canvas canvas({.texels = nullptr,
                 .width = file.width,
                 .height = file.height,
                 .channels = u32(names.size()),
                 .type = plain.type},
                source);
  unpack(file, canvas.texels, source);
  return {std::move(canvas), std::move(names)};
}

// ---------------------------------------------------------------- Basis Universal

/// Its tables take 50 ms of a core, which files without it do not pay.
void start_basis() {
  static const bool started = [] {
    basist::basisu_transcoder_init();
    return true;
  }();
  (void)started;
}

Texels basis_texels(const Ktx2File& file, const PictureSource& source) {
  start_basis();
  Budget::check(source.bytes.size(), std::numeric_limits<u32>::max(), "bytes", source.where);
  source.budget.take(file.unpacked_bytes, 1, source.where);
  basist::ktx2_transcoder reader;
  if (!reader.init(source.bytes.data(), u32(source.bytes.size()))) {
    if (file.vk_format == 0) refuse_broken(source, "Basis Universal cannot read it");
    refuse_unimplemented(source.where,
                         fmt::format("VkFormat {}, which only GPUs read; pack it with Basis "
                                     "Universal (ETC1S or UASTC), or save it as PNG or EXR",
                                     file.vk_format));
  }
  const bool hdr = reader.is_hdr();
  Canvas canvas({.texels = nullptr,
                 .width = file.width,
                 .height = file.height,
                 .channels = 4,
                 .type = hdr ? TexelType::kF16 : TexelType::kU8},
                source);
  using Format = basist::transcoder_texture_format;
  const bool ok =
      reader.start_transcoding() &&
      reader.transcode_image_level(0, 0, 0, canvas.texels.data(), file.width * file.height,
                                   hdr ? Format::cTFRGBA_HALF : Format::cTFRGBA32);
  if (!ok) refuse_broken(source, "Basis Universal cannot unpack it");
  const bool alpha = !hdr && reader.get_has_alpha() != 0;
  return {std::move(canvas), alpha ? Names{"R", "G", "B", "A"} : Names{"R", "G", "B", "unused"}};
}

// ---------------------------------------------------------------- what the numbers mean

/// As EXIF numbers it: the second letter is where rows go, the first where columns go.
u32 orientation_of(const Ktx2File& file) {
  const auto found = file.values.find("KTXorientation");
  const std::string text = found == file.values.end() ? "rd" : found->second;
  if (text.starts_with("ru")) return 4;
  if (text.starts_with("lu")) return 3;
  return text.starts_with("ld") ? 2 : 1;
}

bool is_float(const Canvas& canvas) {
  return canvas.image.type == TexelType::kF16 || canvas.image.type == TexelType::kF32;
}

void warn_of_colours(const Ktx2Format& format, std::vector<std::string>& warnings) {
  constexpr u8 kUnspecified = 0, kRec709 = 1;
  if (format.transfer > Ktx2Format::Transfer::kSrgb) {
    warnings.push_back(
        fmt::format("has the transfer function {} of its data format descriptor; "
                    "its numbers are taken as sRGB",
                    u8(format.transfer)));
  }
  if (format.primaries != kUnspecified && format.primaries != kRec709) {
    warnings.push_back(
        fmt::format("has the primaries {} of its data format descriptor; its "
                    "colours are taken as Rec.709's",
                    format.primaries));
  }
}

}  // namespace

bool is_ktx2(Bytes bytes) {
  constexpr std::string_view kMagic = "\xABKTX 20\xBB\r\n\x1A\n";
  return bytes.size() >= kMagic.size() &&
         std::memcmp(bytes.data(), kMagic.data(), kMagic.size()) == 0;
}

Picture decode_ktx2(const PictureSource& source, std::string_view layer) {
  const Ktx2File file = read_ktx2(source);
  check_shape(file, source.where);
  const Plain* plain = plain_of(file.vk_format);
  Texels texels = plain ? plain_texels(*plain, file, source) : basis_texels(file, source);
  const Selection selection = select_channels(texels.names, layer, source.where);
  Canvas canvas = picked(std::move(texels.canvas), selection.channels, source);
  if (file.format.premultiplied && canvas.image.channels % 2 == 0) make_alpha_straight(canvas);
  if (const u32 orientation = orientation_of(file); orientation > 1) {
    canvas = upright(std::move(canvas), orientation, source);
  }
  const bool srgb = !is_float(canvas) && file.format.transfer != Ktx2Format::Transfer::kLinear;
  Picture picture = std::move(canvas).finish(srgb);
  warn_of_colours(file.format, picture.warnings);
  if (!selection.warning.empty()) picture.warnings.push_back(selection.warning);
  return picture;
}

}  // namespace heliograph::assets
