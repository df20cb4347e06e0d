#include <algorithm>
#include <cstring>

#include "renderer/assets/picture.h"

namespace heliograph::assets {
namespace {

constexpr u32 kLargestSide = 1 << 16;

struct NonFinite {
  u64 infinite = 0;
  u64 nan = 0;
};

/// The bits of halves (10 of mantissa) or floats (23), which are ordered as the magnitudes are.
template <class Word, u32 kMantissaBits>
struct Bits {
  static constexpr Word kMagnitude = Word(~Word(0)) >> 1;
  static constexpr Word kInfinity = Word(Word(~Word(0)) << kMantissaBits) & kMagnitude;

  static Word at(const std::vector<std::byte>& texels, std::size_t i) {
    Word word;
    std::memcpy(&word, &texels[i], sizeof(Word));
    return word;
  }
  static Word largest_finite(const std::vector<std::byte>& texels, Word at_least) {
    for (std::size_t i = 0; i < texels.size(); i += sizeof(Word)) {
      const Word magnitude = at(texels, i) & kMagnitude;
      if (magnitude < kInfinity) at_least = std::max(at_least, magnitude);
    }
    return at_least;
  }
};

/// Infinite texels become the largest finite one of the picture, which is `at_least`; NaN 0.
template <class Word, u32 kMantissaBits>
NonFinite make_finite(std::vector<std::byte>& texels, Word at_least) {
  using Of = Bits<Word, kMantissaBits>;
  NonFinite found;
  Word largest = 0;
  for (std::size_t i = 0; i < texels.size(); i += sizeof(Word)) {
    const Word word = Of::at(texels, i);
    const Word magnitude = word & Of::kMagnitude;
    if (magnitude < Of::kInfinity) continue;
    const bool infinite = magnitude == Of::kInfinity;
    ++(infinite ? found.infinite : found.nan);
    if (infinite && largest == 0) largest = Of::largest_finite(texels, at_least);
    const Word finite = infinite ? Word((word ^ magnitude) | largest) : Word(0);
    std::memcpy(&texels[i], &finite, sizeof(Word));
  }
  return found;
}

constexpr u16 kLargestHalf = 0x7bff;  // 65504
constexpr u32 kLargestHalfAsF32 = 0x477fe000;

}  // namespace

Canvas::Canvas(const ImageData& layout, const PictureSource& source) : image(layout) {
  const auto& [bytes, where, budget] = source;
  if (image.width == 0 || image.height == 0) refuse(where, "the picture has a side of 0 pixels");
  Budget::check(std::max(image.width, image.height), kLargestSide, "pixels on a side", where);
  Budget::check(u64(image.width) * image.height, budget.limits().texels, "texels", where);
  const u64 size = u64(image.width) * image.height * texel_size();
  budget.take(size, 1, where);
  texels.resize(size);
}

std::size_t Canvas::texel_size() const {
  return std::size_t(image.channels) * component_bytes(image.type);
}

Picture Canvas::finish(bool srgb) && {
  Picture picture{.image = image, .srgb = srgb, .warnings = {}};
  NonFinite found;
  if (image.type == TexelType::kF16) found = make_finite<u16, 10>(texels, kLargestHalf);
  if (image.type == TexelType::kF32) found = make_finite<u32, 23>(texels, kLargestHalfAsF32);
  if (found.infinite > 0) {
    picture.warnings.push_back(
        fmt::format("{} infinite texel values became the largest finite one", found.infinite));
  }
  if (found.nan > 0) {
    picture.warnings.push_back(fmt::format("{} texel values that are NaN became 0", found.nan));
  }
  picture.image.texels = ArrayOf<std::byte>(std::move(texels)).buffer();
  return picture;
}

}  // namespace heliograph::assets
