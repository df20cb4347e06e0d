// KTX 2: what Basis Universal packed against the ramp that it was made from, and plain texels in
// files that are written here.
#include <zlib.h>
#include <zstd.h>

#include <cmath>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;

namespace {

std::string text_of(std::initializer_list<int> numbers) {
  std::string text;
  for (const int number : numbers) text += char(number);
  return text;
}

/// A file of one level, two by two texels unless said otherwise.
struct Ktx2 {
  u32 vk_format = 37;
  std::string level;
  u32 width = 2, height = 2, depth = 0, layers = 0, faces = 1, scheme = 0;
  u8 primaries = 1, transfer = 2, flags = 0;
  std::string values;
  u64 unpacked = 0;

  Ktx2& value(const std::string& key, const std::string& text) {
    const std::string entry = key + '\0' + text + '\0';
    const u32 size = u32(entry.size());
    values.append(reinterpret_cast<const char*>(&size), 4);
    values += entry;
    values.resize((values.size() + 3) / 4 * 4);
    return *this;
  }
  [[nodiscard]] std::string bytes() const {
    const u32 descriptor = 44, begin = 104 + descriptor;
    std::string file = "\xABKTX 20\xBB\r\n\x1A\n";
    const auto put = [&](auto number) {
      file.append(reinterpret_cast<const char*>(&number), sizeof number);
    };
    for (u32 n : {vk_format, 1u, width, height, depth, layers, faces, 1u, scheme}) put(n);
    for (u32 n : {104u, descriptor, begin, u32(values.size())}) put(n);
    for (u64 n : {0ull, 0ull}) put(n);
    put(u64(begin + values.size()));
    put(u64(level.size()));
    put(u64(unpacked ? unpacked : level.size()));
    for (u32 n : {descriptor, 0u, 2u | 40u << 16}) put(n);
    for (u8 n : {u8(1), primaries, transfer, flags}) put(n);
    file.append(begin - file.size(), '\0');
    return file + values + level;
  }
  [[nodiscard]] Expected<Loaded> load(const LoadOptions& options = {}) const {
    return TestBundle().add("a.ktx2", bytes()).load(options);
  }
};

Expected<Loaded> load_picture(const std::string& name) {
  return TestBundle().add(name, read_file(test_assets() / "picture" / name)).load();
}

std::string texels_of(const Expected<Loaded>& loaded) {
  INFO(refusal(loaded));
  REQUIRE(loaded);
  const auto bytes = loaded->image->texels->bytes();
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Of the texels of the ramp: the largest difference, and the mean.
std::pair<double, double> errors_of(const Expected<Loaded>& loaded) {
  const std::string texels = texels_of(loaded);
  const u32 channels = loaded->image->channels;
  double largest = 0, sum = 0;
  for (u32 i = 0; i < 32 * 24; ++i) {
    const int x = int(i % 32), y = int(i / 32);
    const int ramp[] = {8 * x, 10 * y, 128, 255 - 4 * (x + y)};
    for (u32 c = 0; c < channels; ++c) {
      const double error = std::abs(int(u8(texels[i * channels + c])) - ramp[c]);
      largest = std::max(largest, error);
      sum += error;
    }
  }
  return {largest, sum / double(texels.size())};
}

}  // namespace

TEST_CASE("ktx2: Basis Universal's two formats give the ramp, its encoding and its alpha") {
  const auto etc1s = load_picture("ramp_etc1s.ktx2");
  const auto uastc = load_picture("ramp_uastc.ktx2");
  CHECK(errors_of(etc1s).second < 8);
  CHECK(errors_of(uastc).first <= 8);
  CHECK(errors_of(uastc).second < 2);
  CHECK((etc1s->image->channels == 4 && etc1s->image_srgb));
  CHECK((uastc->image->channels == 3 && !uastc->image_srgb));
  CHECK((etc1s->image->width == 32 && etc1s->image->height == 24));  // the largest of 6 levels
  CHECK((etc1s->warnings.empty() && uastc->warnings.empty()));
}

TEST_CASE("ktx2: UASTC of high range gives halves") {
  const auto loaded = load_picture("hdr_uastc.ktx2");
  const std::string texels = texels_of(loaded);  // 100 times red
  CHECK(loaded->image->type == TexelType::kF16);
  CHECK_FALSE(loaded->image_srgb);
  CHECK(texels.substr(0, 6) == text_of({0x40, 0x56, 0, 0, 0, 0}));
}

TEST_CASE("ktx2: plain texels of every packing") {
  const std::string rgba = "abcdefghijklmnop";
  CHECK(texels_of(Ktx2{43, rgba}.load()) == rgba);
  CHECK(texels_of(Ktx2{44, rgba}.load()) == "cbadgfehkjilonmp");
  CHECK(texels_of(Ktx2{30, "abcdefghijkl"}.load()) == "cbafedihglkj");
  CHECK(texels_of(Ktx2{91, rgba + rgba}.load()) == rgba + rgba);
  std::string packed(100, '\0');
  uLongf size = packed.size();
  REQUIRE(compress(reinterpret_cast<Bytef*>(packed.data()), &size,
                   reinterpret_cast<const Bytef*>(rgba.data()), rgba.size()) == Z_OK);
  Ktx2 file{37, packed.substr(0, size)};
  file.scheme = 3;
  file.unpacked = rgba.size();
  CHECK(texels_of(file.load()) == rgba);
  file.scheme = 2;
  CHECK_THAT(refusal(file.load()), Contains("does not hold its texels"));
  file.level.resize(100);
  file.level.resize(ZSTD_compress(file.level.data(), 100, rgba.data(), rgba.size(), 3));
  CHECK(texels_of(file.load()) == rgba);
}

TEST_CASE("ktx2: the descriptor says what the numbers are") {
  Ktx2 file{37, text_of({10, 20, 30, 128, 1, 2, 3, 255, 9, 9, 9, 0, 60, 60, 60, 100})};
  CHECK(file.load()->image_srgb);
  file.transfer = 1;
  CHECK_FALSE(file.load()->image_srgb);
  file.flags = 1;
  CHECK(texels_of(file.load()) ==
        text_of({20, 40, 60, 128, 1, 2, 3, 255, 9, 9, 9, 0, 153, 153, 153, 100}));
  file.primaries = 4;
  file.transfer = 3;
  const auto loaded = file.load();
  REQUIRE(loaded->warnings.size() == 2);
  CHECK_THAT(loaded->warnings[0], Contains("transfer function 3"));
  CHECK_THAT(loaded->warnings[1], Contains("primaries 4"));
}

TEST_CASE("ktx2: rows and columns go where KTXorientation says") {
  const auto turned = [](const char* orientation) {
    return texels_of(Ktx2{9, "abcd"}.value("KTXorientation", orientation).load());
  };
  CHECK(turned("rd") == "abcd");
  CHECK(turned("ru") == "cdab");
  CHECK(turned("ld") == "badc");
  CHECK(turned("lu") == "dcba");
}

TEST_CASE("ktx2: grey, alpha and lone channels") {
  const auto grey = Ktx2{16, "aAbBcCdD"}.value("KTXswizzle", "rrrg").load();
  CHECK((texels_of(grey) == "aAbBcCdD" && grey->warnings.empty()));
  CHECK_THAT(Ktx2({16, "aAbBcCdD"}).load()->warnings.at(0), Contains("R, G"));
  CHECK_THAT(refusal(Ktx2{16, "aAbBcCdD"}.value("KTXswizzle", "gggr").load()),
             Contains("KTXswizzle 'gggr'"));
  CHECK(texels_of(Ktx2{37, "abcdefghijklmnop"}.load({.layer = "G"})) == "bfjn");
  CHECK_THAT(refusal(Ktx2{37, "abcdefghijklmnop"}.load({.layer = "Z"})),
             Contains("no layer 'Z'") && Contains("R, G, B, A"));
}

TEST_CASE("ktx2: what is no plain picture is refused by name") {
  const auto refused = [](auto change) {
    Ktx2 file{37, std::string(16, 'x')};
    change(file);
    return refusal(file.load());
  };
  CHECK_THAT(refusal(load_picture("cube_etc1s.ktx2")), Contains("cube map"));
  CHECK_THAT(refused([](Ktx2& f) { f.layers = 2; }), Contains("an array"));
  CHECK_THAT(refused([](Ktx2& f) { f.depth = 2; }), Contains("volume"));
  CHECK_THAT(refused([](Ktx2& f) { f.vk_format = 145; }),
             Contains("12 ") && Contains("VkFormat 145"));
  CHECK_THAT(refused([](Ktx2& f) { f.vk_format = 0; }), Contains("Basis Universal cannot read it"));
  CHECK_THAT(refused([](Ktx2& f) { f.level.pop_back(); }), Contains("does not hold its texels"));
  CHECK_THAT(refused([](Ktx2& f) { f.width = f.height = 60000; }), Contains("8 "));
}

TEST_CASE("ktx2: a file that ends early, or has a byte changed, is read or refused") {
  for (const char* name : {"ramp_etc1s.ktx2", "ramp_uastc.ktx2"}) {
    const std::vector<std::byte> whole = read_file(test_assets() / "picture" / name);
    for (std::size_t i = 12; i < whole.size(); i += 3) {
      std::vector<std::byte> changed = whole;
      changed[i] ^= std::byte(0x81);
      (void)TestBundle().add("a.ktx2", changed).load();
      changed.resize(i);
      CHECK_FALSE(TestBundle().add("a.ktx2", changed).load());
    }
  }
}

TEST_CASE("ktx2: the picture of KHR_texture_basisu goes before the texture's own") {
  TestBundle bundle;
  bundle.add("m.gltf",
             R"({"asset":{"version":"2.0"},"extensionsRequired":["KHR_texture_basisu"],)"
             R"("images":[{"uri":"a.png"},{"uri":"b.ktx2"}],)"
             R"("textures":[{"source":0,"extensions":{"KHR_texture_basisu":{"source":1}}}],)"
             R"("materials":[{"normalTexture":{"index":0}}]})");
  CHECK(bundle.load()->missing == std::vector<std::string>{"b.ktx2"});
  bundle.add("b.ktx2", read_file(test_assets() / "picture/ramp_uastc.ktx2"));
  const auto loaded = bundle.load();
  REQUIRE(loaded);
  CHECK(loaded->warnings.empty());
  CHECK(std::get<PutTexture>(loaded->asset.library.front().action).image->width == 32);
}

TEST_CASE("ktx2: names and content") {
  const auto wrong = TestBundle().add("a.png", Ktx2{9, "abcd"}.bytes()).load();
  CHECK((texels_of(wrong) == "abcd" && wrong->warnings.size() == 1));
  CHECK_THAT(wrong->warnings.at(0), Contains("named as PNG and is KTX2"));
  CHECK_THAT(refusal(TestBundle().add("a.ktx2", "no picture").load()), Contains("named as KTX2"));
}
