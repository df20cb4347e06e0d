#include <sys/mman.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <new>

#include "renderer/assets/picture.h"
#include "renderer/base/finite.h"

namespace heliograph::assets {
namespace {

constexpr u32 kLargestSide = 1 << 16;

struct NonFinite {
  u64 infinite = 0;
  u64 nan = 0;
};

/// Infinite texels become the largest finite one of the picture, which is `at_least`; NaN 0.
template <class Word, u32 kMantissaBits>
NonFinite make_finite(std::span<std::byte> texels, Word at_least) {
  using Of = FloatBits<Word, kMantissaBits>;
  const std::span words(reinterpret_cast<Word*>(texels.data()), texels.size() / sizeof(Word));
  NonFinite found;
  if (Of::all_finite(words)) return found;
  Word largest = at_least;
  for (const Word word : words) {
    const Word magnitude = word & Of::kMagnitude;
    if (magnitude < Of::kInfinity) largest = std::max(largest, magnitude);
  }
  for (Word& word : words) {
    const Word magnitude = word & Of::kMagnitude;
    if (magnitude < Of::kInfinity) continue;
    const bool infinite = magnitude == Of::kInfinity;
    ++(infinite ? found.infinite : found.nan);
    word = infinite ? Word((word ^ magnitude) | largest) : Word(0);
  }
  return found;
}

/// Asks for large pages of what is still to be written: the system zeroes 2 MiB at a time.
void ask_for_large_pages(std::span<std::byte> bytes) {
  constexpr std::size_t kLarge = 2 << 20;
  void* begin = bytes.data();
  std::size_t size = bytes.size();
  if (std::align(kLarge, kLarge, begin, size))
    (void)::madvise(begin, size / kLarge * kLarge, MADV_HUGEPAGE);
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
  owner_.reset(static_cast<std::byte*>(std::calloc(size, 1)));
  if (!owner_) throw std::bad_alloc();
  texels = {owner_.get(), size};
  ask_for_large_pages(texels);
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
  picture.image.texels =
      std::make_shared<const Buffer>(std::shared_ptr<const void>(std::move(owner_)), texels);
  return picture;
}

}  // namespace heliograph::assets
