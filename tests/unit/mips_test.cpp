// Textures at smaller sizes: what their levels hold, and which level a ray cone sees.
#include "renderer/derived/mips.h"

#include "kernels/material/texture.h"
#include "tests/unit/catch.h"
#include "tests/unit/random.h"

using namespace heliograph;
using namespace heliograph::test;
using kernels::TextureView;
using kernels::vec4;

namespace {

/// A texture with its levels.
class Chain {
 public:
  template <class T>
  Chain(kernels::uvec2 size, u32 channels, TexelType type, std::vector<T> texels, bool srgb = false)
      : cache_(1 << 20) {
    const auto owner = std::make_shared<const std::vector<T>>(std::move(texels));
    auto image = std::make_shared<ImageData>();
    image->texels = std::make_shared<const Buffer>(owner, std::as_bytes(std::span(*owner)));
    view_ = {.texels = image->texels->bytes().data(),
             .width = size.x,
             .height = size.y,
             .channels = u8(channels),
             .type = kernels::TexelType(type),
             .srgb = srgb};
    texture_ = {.image = image, .srgb = srgb};
    mips_ = resident::mips_of(texture_, view_, cache_);
    if (mips_) view_.mips = mips_->texels.data();
  }
  [[nodiscard]] const TextureView& view() const { return view_; }
  /// Level 0 is the texture.
  [[nodiscard]] TextureView level(int number) const {
    return kernels::level_of(view_, std::ldexp(1.0f, number));
  }

 private:
  resident::DerivedCache cache_;
  Texture texture_;
  TextureView view_{};
  std::shared_ptr<const resident::Mips> mips_;
};

vec4 mean_of(const TextureView& view) {
  glm::dvec4 sum(0);
  for (u64 i = 0; i < u64(view.width) * view.height; ++i)
    sum += glm::dvec4(kernels::load_rgba(view, i));
  return vec4(sum / (double(view.width) * view.height));
}

}  // namespace

TEST_CASE("mips: every level has the mean of the texture, of any size") {
  Random random(3);
  for (const kernels::uvec2 size : {kernels::uvec2(16, 16), {37, 22}, {5, 64}, {3, 3}}) {
    std::vector<float> texels(size_t(size.x) * size.y * 3);
    for (float& texel : texels) texel = random.next();
    const Chain chain(size, 3, TexelType::kF32, texels);
    const vec4 mean = mean_of(chain.view());
    for (int number = 1; number < 8; ++number) {
      const TextureView level = chain.level(number);
      for (int c = 0; c < 3; ++c) CHECK(mean_of(level)[c] == Approx(mean[c]).epsilon(1e-5));
    }
  }
}

TEST_CASE("mips: a constant stays what it was, in every type") {
  const auto check = [](const Chain& chain) {
    const vec4 before = kernels::load_rgba(chain.view(), 0);
    for (int number = 1; number < 5; ++number) {
      const TextureView level = chain.level(number);
      REQUIRE(level.texels != chain.view().texels);
      for (u64 i = 0; i < u64(level.width) * level.height; ++i)
        CHECK(kernels::load_rgba(level, i) == before);
    }
  };
  check(Chain({9, 6}, 2, TexelType::kU8, std::vector<u8>(108, 93), true));
  check(Chain({8, 8}, 4, TexelType::kU8, std::vector<u8>(256, 201)));
  check(Chain({7, 8}, 1, TexelType::kU16, std::vector<u16>(56, 12345)));
  check(Chain({8, 8}, 3, TexelType::kF16, std::vector<u16>(192, 0x3555)));  // 1/3
  check(Chain({8, 8}, 3, TexelType::kF16, std::vector<u16>(192, 0x0123)));  // subnormal
  check(Chain({8, 8}, 3, TexelType::kF32, std::vector<float>(192, -2.5f)));
}

TEST_CASE("mips: sRGB texels are averaged as light") {
  const Chain chain({2, 2}, 1, TexelType::kU8, std::vector<u8>{255, 0, 0, 255}, true);
  CHECK(kernels::load_rgba(chain.level(1), 0).x == Approx(0.5f).margin(0.004));
}

TEST_CASE("mips: a level is never blurrier than the footprint") {
  const Chain chain({64, 32}, 1, TexelType::kF32, std::vector<float>(2048, 1));
  CHECK(kernels::level_of(chain.view(), 0).width == 64);
  CHECK(kernels::level_of(chain.view(), 1.9f).width == 64);
  CHECK(kernels::level_of(chain.view(), 2).width == 32);
  CHECK(kernels::level_of(chain.view(), 7.9f).width == 16);
  CHECK(kernels::level_of(chain.view(), 1e9f).height == 1);
}
