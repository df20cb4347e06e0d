#include "renderer/assets/picture.h"

#include <algorithm>
#include <array>
#include <cstring>

namespace heliograph::assets {
namespace {

constexpr u32 kLargestSide = 1 << 16;

constexpr std::array<const char*, 6> kFormatNames = {"none", "PNG", "JPEG", "EXR", "HDR", "TIFF"};

bool starts_with(Bytes bytes, std::string_view magic) {
  return bytes.size() >= magic.size() && std::memcmp(bytes.data(), magic.data(), magic.size()) == 0;
}

/// Whether a half (10 bits of mantissa) or a float (23) is NaN or infinite.
template <class Word, u32 kMantissaBits>
u64 clear_non_finite(std::vector<std::byte>& texels) {
  constexpr Word kExponent = Word(Word(~Word(0)) << kMantissaBits) & Word(Word(~Word(0)) >> 1);
  u64 count = 0;
  for (std::size_t i = 0; i + sizeof(Word) <= texels.size(); i += sizeof(Word)) {
    Word word;
    std::memcpy(&word, &texels[i], sizeof(Word));
    if ((word & kExponent) != kExponent) continue;
    std::memset(&texels[i], 0, sizeof(Word));
    ++count;
  }
  return count;
}

}  // namespace

PictureFormat picture_format(Bytes bytes) {
  using namespace std::string_view_literals;
  if (starts_with(bytes, "\x89PNG\r\n\x1a\n"sv)) return PictureFormat::kPng;
  if (starts_with(bytes, "\xff\xd8\xff"sv)) return PictureFormat::kJpeg;
  if (starts_with(bytes, "\x76\x2f\x31\x01"sv)) return PictureFormat::kExr;
  if (starts_with(bytes, "#?RADIANCE"sv) || starts_with(bytes, "#?RGBE"sv)) {
    return PictureFormat::kHdr;
  }
  if (starts_with(bytes, "II*\0"sv) || starts_with(bytes, "MM\0*"sv)) return PictureFormat::kTiff;
  return PictureFormat::kNone;
}

PictureFormat picture_format(std::string_view name) {
  if (name.starts_with("image/")) name.remove_prefix(6);
  if (name == "png") return PictureFormat::kPng;
  if (name == "jpg" || name == "jpeg") return PictureFormat::kJpeg;
  if (name == "exr") return PictureFormat::kExr;
  if (name == "hdr" || name == "pic") return PictureFormat::kHdr;
  if (name == "tif" || name == "tiff") return PictureFormat::kTiff;
  return PictureFormat::kNone;
}

Canvas::Canvas(const ImageData& layout, const PictureSource& source) : image(layout) {
  const auto& [bytes, where, budget] = source;
  if (image.width == 0 || image.height == 0) refuse(where, "the picture has a side of 0 pixels");
  Budget::check(std::max(image.width, image.height), kLargestSide, "pixels on a side", where);
  Budget::check(u64(image.width) * image.height, budget.limits().texels, "texels", where);
  const u64 size = u64(image.width) * image.height * image.channels * texel_bytes(image.type);
  budget.take(size, 1, where);
  texels.resize(size);
}

Picture Canvas::finish(bool srgb) && {
  Picture picture{.image = image, .srgb = srgb, .warnings = {}};
  u64 cleared = 0;
  if (image.type == TexelType::kF16) cleared = clear_non_finite<u16, 10>(texels);
  if (image.type == TexelType::kF32) cleared = clear_non_finite<u32, 23>(texels);
  if (cleared > 0) {
    picture.warnings.push_back(
        fmt::format("{} texel values are NaN or infinite and were set to 0", cleared));
  }
  picture.image.texels = ArrayOf<std::byte>(std::move(texels)).buffer();
  return picture;
}

Picture decode_picture(Bytes bytes, std::string_view name, const std::string& where,
                       Budget& budget) {
  const PictureFormat named = picture_format(name);
  const PictureFormat found = picture_format(bytes);
  if (named == PictureFormat::kNone) {
    refuse_unimplemented(where,
                         fmt::format("pictures are PNG, JPEG, EXR, HDR or TIFF, not '{}'", name));
  }
  if (found != named) {
    refuse(where, fmt::format("is named as {} but its first bytes are {}; rename or re-export it",
                              kFormatNames[std::size_t(named)],
                              found == PictureFormat::kNone
                                  ? "those of no picture format"
                                  : std::string(kFormatNames[std::size_t(found)]) + "'s"));
  }
  const PictureSource source{bytes, where, budget};
  switch (found) {
    case PictureFormat::kPng:
      return decode_png(source);
    case PictureFormat::kJpeg:
      return decode_jpeg(source);
    case PictureFormat::kExr:
      return decode_exr(source);
    case PictureFormat::kHdr:
      return decode_hdr(source);
    case PictureFormat::kTiff:
      return decode_tiff(source);
    case PictureFormat::kNone:
      break;
  }
  refuse(where, "is no picture");
}

}  // namespace heliograph::assets
