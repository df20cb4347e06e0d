// IES files: what their ranges and factors mean, and what is refused by its line.
#include <cmath>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;

namespace {

/// A file whose candela follow these angles; `sizes` counts them.
std::string file(const std::string& sizes, const std::string& angles,
                 const std::string& head = "IESNA:LM-63-2002\nTILT=NONE\n",
                 const std::string& factors = "1 1 0") {
  return fmt::format("{}1 -1 1 {} 1 2 0 0 0\n{}\n{}\n", head, sizes, factors, angles);
}
Expected<Loaded> load(const std::string& text) { return TestBundle().add("a.ies", text).load(); }

/// Candela at a vertical angle, by column.
std::vector<float> row(const Loaded& loaded, float degrees) {
  const ImageData& image = *loaded.image;
  REQUIRE(image.type == TexelType::kF32);
  REQUIRE(image.channels == 1);
  const float at = degrees / 180 * float(image.height - 1);
  REQUIRE(at == std::round(at));
  std::vector<float> out(image.width);
  std::memcpy(out.data(),
              image.texels->bytes().data() + std::size_t(at) * image.width * sizeof(float),
              image.width * sizeof(float));
  return out;
}

}  // namespace

TEST_CASE("ies: each horizontal range unfolds by its symmetry") {
  using Row = std::vector<float>;
  const auto level = [](const std::string& sizes, const std::string& angles) {
    const auto loaded = load(file(sizes, angles));
    INFO(refusal(loaded));
    REQUIRE(loaded);
    return row(*loaded, 45);
  };
  CHECK(level("3 1", "0 45 90  0  9 7 5") == Row{7});
  CHECK(level("3 3", "0 45 90  0 45 90  9 1 5  9 2 5  9 3 5") == Row{1, 2, 3, 2, 1, 2, 3, 2});
  CHECK(level("3 3", "0 45 90  0 90 180  9 1 5  9 2 5  9 3 5") == Row{1, 2, 3, 2});
  CHECK(level("3 3", "0 45 90  90 180 270  9 1 5  9 2 5  9 3 5") == Row{2, 1, 2, 3});
  CHECK(level("3 5", "0 45 90  0 90 180 270 360  9 1 5  9 2 5  9 3 5  9 4 5  9 1 5") ==
        Row{1, 2, 3, 4});
  CHECK(level("3 4", "0 45 90  0 90 180 270  9 1 5  9 2 5  9 3 5  9 4 5") == Row{1, 2, 3, 4});
}

TEST_CASE("ies: vertical ranges, angles between others, and what is dark") {
  const auto below = load(file("2 1", "0 90 0 8 4"));
  REQUIRE(below);
  CHECK(row(*below, 0)[0] == 8);
  CHECK(row(*below, 90)[0] == 4);
  CHECK(row(*below, 180)[0] == 0);
  const auto above = load(file("3 1", "90 135 180 0 8 4 2"));
  REQUIRE(above);
  CHECK(row(*above, 0)[0] == 0);
  CHECK(row(*above, 90)[0] == 8);
  CHECK(row(*above, 180)[0] == 2);
  // These fit no even steps: what is between is linear on a fine grid.
  const auto uneven = load(file("5 1", "0 7.3 11.11 23.457 90 0 0 73 0 0 0"));
  REQUIRE(uneven);
  CHECK(uneven->image->height == 1441);
  CHECK(row(*uneven, 5)[0] == Approx(50));
}

TEST_CASE("ies: multiplier and ballast factors count, as far as the version has them") {
  const std::string angles = "0 90 0 8 4";
  const auto nadir = [&](const std::string& head) {
    const auto loaded = load(file("2 1", angles, head + "TILT=NONE\n", "0.5 0.25 60"));
    INFO(refusal(loaded));
    REQUIRE(loaded);
    return row(*loaded, 0)[0];
  };
  CHECK(nadir("IESNA:LM-63-2002\n") == 4);
  CHECK(nadir("\xef\xbb\xbfIES:LM-63-2019\r\n") == 4);
  CHECK(nadir("IESNA:LM-63-1995\n") == 1);
  CHECK(nadir("IESNA91\n[TEST] x\n") == 1);
  CHECK(nadir("Trough with two lamps\n") == 1);
  const auto batwing = read_file(test_assets() / "profile/batwing.ies");
  const auto loaded = TestBundle().add("batwing.ies", batwing).load();
  REQUIRE(loaded);
  CHECK(row(*loaded, 45) == std::vector<float>{120 * 1.8f, 170 * 1.8f, 220 * 1.8f, 170 * 1.8f,
                                               120 * 1.8f, 170 * 1.8f, 220 * 1.8f, 170 * 1.8f});
}

TEST_CASE("ies: a tilt that is included is skipped, and said") {
  const auto loaded =
      load(file("2 1", "0 90 0 8 4", "IESNA91\nTILT=INCLUDE\n1\n3\n0 45 90\n1 0.9 0.8\n"));
  REQUIRE(loaded);
  CHECK_THAT(loaded->warnings.at(0), Contains("TILT=INCLUDE") && Contains("profile_scale"));
  CHECK(row(*loaded, 0)[0] == 8);
}

TEST_CASE("ies: what is wrong is refused by its line") {
  const auto says = [](const std::string& text) { return refusal(load(text)); };
  const std::string head = "IESNA:LM-63-2002\nTILT=NONE\n";
  CHECK_THAT(says("IESNA:LM-63-2002\n1 2 3\n"), Contains("no line begins with TILT="));
  CHECK_THAT(says("IES:LM-63-2031\nTILT=NONE\n"), Contains("12 a.ies: line 1") && Contains("2019"));
  CHECK_THAT(says("IESNA91\nTILT=lamp.tlt\n"), Contains("12 a.ies: line 2") && Contains("NONE"));
  CHECK_THAT(says(head + "1 -1 1 2 1 3 2 0 0 0"), Contains("12 ") && Contains("type A"));
  CHECK_THAT(says(head + "1 -1 1 2 1 2 2 0 0 0"), Contains("12 ") && Contains("type B"));
  CHECK_THAT(says(head + "1 -1 1 2 1 7 2 0 0 0"), Contains("line 3") && Contains("photometric"));
  CHECK_THAT(says(head + "1 -1 -1 2 1 1 2 0 0 0"), Contains("multiplier is -1"));
  CHECK_THAT(says(head + "1 -1 1 9999999 1 1 2 0 0 0"), Contains("vertical") && Contains("rest"));
  CHECK_THAT(says(head + "1 -1 1 2.5 1 1 2 0 0 0"), Contains("whole number"));
  CHECK_THAT(says(file("2 1", "0 90 0 8 -4")), Contains("line 5") && Contains("-4, below 0"));
  CHECK_THAT(says(file("2 1", "0 90 0 8 nan")), Contains("'nan'"));
  CHECK_THAT(says(file("2 1", "0 90 0 8")), Contains("ends before a candela value"));
  CHECK_THAT(says(file("2 1", "0 90 0 8 4 2")), Contains("line 5") && Contains("last candela"));
  CHECK_THAT(says(file("3 1", "0 90 45 0 8 4 2")), Contains("45 does not exceed"));
  CHECK_THAT(says(file("2 1", "10 90 0 8 4")), Contains("vertical angles go from 10"));
  CHECK_THAT(says(file("2 1", "0 95 0 8 4")), Contains("vertical angles go from 0 to 95"));
  CHECK_THAT(says(file("2 2", "0 90 0 120 8 4 8 4")), Contains("horizontal") && Contains("120"));
  CHECK_THAT(says(file("2 1", "0 90 0 1e30 4", head, "1e30 1 0")), Contains("not finite"));
}
