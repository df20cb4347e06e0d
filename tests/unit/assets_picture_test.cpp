// Pictures: every format against the gradient it was made from, and what is refused.
#include <algorithm>
#include <cmath>
#include <map>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;

namespace {

Expected<Loaded> load_picture(const std::string& name) {
  const std::filesystem::path path = test_assets() / "picture" / name;
  return TestBundle().add(name, read_file(path)).load();
}

float half_to_float(u16 h) {
  const float sign = h & 0x8000 ? -1.0f : 1.0f;
  const int exponent = h >> 10 & 31;
  const float mantissa = float(h & 1023) / 1024;
  return sign * (exponent ? std::ldexp(1 + mantissa, exponent - 15) : std::ldexp(mantissa, -14));
}

/// Texel as a float; integers normalised.
float texel(const ImageData& image, u32 x, u32 y, u32 c) {
  const std::size_t i = (std::size_t(y) * image.width + x) * image.channels + c;
  const std::byte* bytes = image.texels->bytes().data();
  u16 word = 0;
  float number = 0;
  switch (image.type) {
    case TexelType::kU8:
      return float(u8(bytes[i])) / 255;
    case TexelType::kU16:
      std::memcpy(&word, bytes + 2 * i, 2);
      return float(word) / 65535;
    case TexelType::kF16:
      std::memcpy(&word, bytes + 2 * i, 2);
      return half_to_float(word);
    case TexelType::kF32:
      std::memcpy(&number, bytes + 4 * i, 4);
      return number;
  }
  return 0;
}

/// The corners of the gradient: black, red, green, white.
vec3 gradient(u32 x, u32 y) {
  const float u = float(x) / 15, v = float(y) / 7;
  const vec3 top = glm::mix(vec3(0), vec3(1, 0, 0), u);
  return glm::mix(top, glm::mix(vec3(0, 1, 0), vec3(1), u), v);
}

double largest_error(const ImageData& image) {
  double worst = 0;
  for (u32 y = 0; y < 8; ++y) {
    for (u32 x = 0; x < 16; ++x) {
      for (u32 c = 0; c < 3; ++c) {
        worst = std::max(worst, std::abs(double(texel(image, x, y, c)) - gradient(x, y)[int(c)]));
      }
    }
  }
  return worst;
}

}  // namespace

TEST_CASE("picture: every format gives the gradient it holds") {
  struct Case {
    const char* name;
    TexelType type;
    double tolerance;
    bool srgb;
  };
  const Case cases[] = {{"gradient16.png", TexelType::kU16, 1e-5, false},
                        {"gradient.jpg", TexelType::kU8, 0.12, true},
                        {"gradient_planar.tif", TexelType::kU8, 0.003, true},
                        {"gradient_tiled.tif", TexelType::kU16, 1e-5, true},
                        {"gradient_float.tif", TexelType::kF32, 1e-6, false},
                        {"gradient.hdr", TexelType::kF32, 0.01, false},
                        {"gradient.bmp", TexelType::kU8, 0.003, true},
                        {"gradient.tga", TexelType::kU8, 0.003, true},
                        {"gradient.webp", TexelType::kU8, 0.003, true},
                        {"gradient.jp2", TexelType::kU8, 0.003, true},
                        {"gradient.jxl", TexelType::kU8, 0.003, false},
                        {"gradient.psd", TexelType::kU8, 0.003, true},
                        {"gradient.ppm", TexelType::kU8, 0.003, true},
                        {"gradient.sgi", TexelType::kU8, 0.003, true},
                        {"gradient.rla", TexelType::kU8, 0.003, false},
                        {"gradient.iff", TexelType::kU8, 0.003, true},
                        {"gradient.dpx", TexelType::kU8, 0.003, false},
                        {"gradient.ico", TexelType::kU8, 0.003, true},
                        {"gradient.dds", TexelType::kU8, 0.003, true},
                        {"gradient_cmyk.jpg", TexelType::kU8, 0.12, true},
                        {"gradient_palette.tif", TexelType::kU8, 0.006, true}};
  for (const Case& c : cases) {
    INFO(c.name);
    const auto loaded = load_picture(c.name);
    INFO(refusal(loaded));
    REQUIRE(loaded);
    REQUIRE(loaded->image);
    CHECK(loaded->image->width == 16);
    CHECK(loaded->image->height == 8);
    CHECK(loaded->image->channels == 3);
    CHECK(loaded->image->type == c.type);
    CHECK(loaded->image_srgb == c.srgb);
    CHECK(largest_error(*loaded->image) < c.tolerance);
    CHECK(loaded->warnings.empty());
  }
}

TEST_CASE("picture: an EXR's data window lies in its display window") {
  const auto loaded = load_picture("windowed.exr");
  REQUIRE(loaded);
  const ImageData& image = *loaded->image;
  CHECK(image.width == 16);
  CHECK(image.height == 8);
  CHECK(texel(image, 3, 3, 0) == 0);
  CHECK(texel(image, 5, 3, 0) == Approx(gradient(5, 3).x));
  CHECK(texel(image, 11, 5, 1) == Approx(gradient(11, 5).y));
  CHECK(texel(image, 12, 5, 1) == 0);
  const auto inside = load_picture("t08.exr");
  REQUIRE(inside);
  CHECK(inside->image->width == 501);
}

TEST_CASE("picture: other primaries become Rec.709, and white stays white") {
  const auto loaded = load_picture("gradient_rec2020.exr");
  REQUIRE(loaded);
  CHECK_THAT(loaded->warnings.at(0), Contains("Rec.709"));
  const ImageData& image = *loaded->image;
  for (u32 c = 0; c < 3; ++c) CHECK(texel(image, 15, 7, c) == Approx(1).epsilon(2e-3));
  // Rec.2020 red in Rec.709: ITU-R BT.2087.
  CHECK(texel(image, 15, 0, 0) == Approx(1.6605).epsilon(5e-3));
  CHECK(texel(image, 15, 0, 1) == Approx(-0.1246).epsilon(2e-2));
}

TEST_CASE("picture: NaN becomes 0, infinity the largest half, and both are counted") {
  const auto loaded = load_picture("AllHalfValues.exr");
  REQUIRE(loaded);
  // In each of three channels: 2 infinities, and 2,046 NaN.
  CHECK_THAT(loaded->warnings.at(0), Contains("6 infinite"));
  CHECK_THAT(loaded->warnings.at(1), Contains("6138") && Contains("NaN"));
  const auto bytes = loaded->image->texels->bytes();
  std::map<u16, int> largest;
  for (std::size_t i = 0; i < bytes.size(); i += 2) {
    u16 word;
    std::memcpy(&word, &bytes[i], 2);
    REQUIRE((word & 0x7c00) != 0x7c00);
    if ((word & 0x7fff) == 0x7bff) ++largest[word];
  }
  CHECK(largest == std::map<u16, int>{{0x7bff, 6}, {0xfbff, 6}});  // 65504 itself, and infinity
}

TEST_CASE("picture: gray, gray with alpha, interlaced") {
  CHECK(load_picture("cube_depth.png")->image->channels == 1);
  CHECK(load_picture("gray_alpha.tif")->image->channels == 2);
  CHECK(load_picture("stripes.exr")->image->channels == 4);
}

TEST_CASE("picture: the content says what the format is, a wrong name is a warning") {
  const auto png = read_file(test_assets() / "picture/gradient16.png");
  for (const char* name : {"a.jpg", "a.iff", "a.tga", "a.hdr"}) {
    INFO(name);
    const auto loaded = TestBundle().add(name, png).load();
    REQUIRE(loaded);
    CHECK(loaded->image->width == 16);
    CHECK_THAT(loaded->warnings.at(0), Contains("is named as") && Contains("is PNG"));
  }
  CHECK(TestBundle().add("a", png).load()->warnings.empty());
  CHECK_THAT(refusal(TestBundle().add("a", "words, not texels").load()), Contains("12 "));
  CHECK_THAT(refusal(TestBundle().add("a.png", "FOR4....").load()), Contains("Not a PNG"));
}

TEST_CASE("picture: truncated files are refused") {
  for (const auto& file : std::filesystem::directory_iterator(test_assets() / "picture")) {
    const std::string name = file.path().filename();
    if (name == "orm.png") continue;  // its last tenth is the end marker
    auto bytes = read_file(test_assets() / "picture" / name);
    for (const double share : {0.3, 0.6, 0.9}) {
      INFO(name << " " << share);
      auto part = bytes;
      part.resize(std::size_t(double(bytes.size()) * share));
      CHECK_FALSE(TestBundle().add(name, part).load());
    }
  }
}

TEST_CASE("picture: a bomb is refused by its header") {
  // A PNG of 100,000 x 100,000 in 33 bytes, an HDR, an EXR window.
  auto png = read_file(test_assets() / "picture/gradient16.png");
  png[16] = png[20] = std::byte(0);
  png[17] = png[21] = std::byte(1);  // 65,5xx each; the CRC no longer matches
  CHECK_FALSE(TestBundle().add("a.png", png).load());
  const auto hdr = TestBundle()
                       .add("a.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 100000\n")
                       .load();
  CHECK_THAT(refusal(hdr), Contains("8 a.hdr") && Contains("texels"));
  const auto wide =
      TestBundle().add("a.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n").load();
  CHECK_THAT(refusal(wide), Contains("texels"));
  auto exr = read_file(test_assets() / "picture/stripes.exr");
  const std::string_view name = "dataWindow";
  auto at = std::search(exr.begin(), exr.end(), name.begin(), name.end(),
                        [](std::byte a, char b) { return char(a) == b; });
  REQUIRE(at != exr.end());
  for (const auto& [side, message] :
       {std::pair(60000, "8 a.exr"), std::pair(0x7ffffff0, "data window")}) {
    std::memcpy(&*at + 11 + 6 + 4 + 8, &side, 4);
    std::memcpy(&*at + 11 + 6 + 4 + 12, &side, 4);
    CHECK_THAT(refusal(TestBundle().add("a.exr", exr).load()), Contains(message));
  }
  LoadOptions small;
  small.limits.bytes = 100;
  CHECK_THAT(refusal(TestBundle()
                         .add("a.png", read_file(test_assets() / "picture/gradient16.png"))
                         .load(small)),
             Contains("the limit is 100"));
}
