// Arrays, half floats, poses: no daemon needed.
#include <cmath>

#include "fixture.h"

using namespace heliograph::client;

TEST_CASE("an array has the dtype and the shape of its C++ type") {
  const Array points(std::vector<std::array<float, 3>>{{1, 2, 3}, {4, 5, 6}});
  CHECK(points.dtype() == DType::kF32);
  CHECK(points.shape() == Shape{2, 3});
  CHECK(points.view<float>()(1, 2) == 6);
  CHECK(points.view<std::array<float, 3>>()[1][0] == 4);
  CHECK(Array(std::vector<Mat4f>(5)).shape() == Shape{5, 4, 4});
  CHECK(Array(std::vector<Pose>(2)).dtype() == DType::kF64);
}

TEST_CASE("a view of another type is refused and says what the array is") {
  const Array numbers(std::vector<std::uint32_t>{1, 2, 3});
  const ClientError error = error_of([&] { (void)numbers.view<float>(); });
  CHECK(error.code() == Code::kInvalidArgument);
  CHECK(contains(error.what(), "(3,) u32"));
  CHECK_THROWS_AS((numbers.view<std::array<std::uint32_t, 2>>()), ClientError);
}

TEST_CASE("a view keeps its memory, borrowed memory is not copied") {
  const auto view = Array(std::vector<float>(1000, 7.0f)).view<float>();  // the array is gone
  CHECK(view[999] == 7);
  const std::vector<float> mine{1, 2, 3, 4};
  CHECK(Array::borrow(mine.data(), {2, 2}).view<float>().data() == mine.data());
}

TEST_CASE("half floats round to nearest even and come back") {
  for (std::uint32_t bits = 0; bits < 0x7c00; ++bits) {
    const Half half{std::uint16_t(bits)};
    REQUIRE(Half::of(half.value()).bits == bits);
    const float next = Half{std::uint16_t(bits + 1)}.value();
    if (bits + 1 == 0x7c00) continue;
    const float middle = 0.5f * (half.value() + next);
    REQUIRE(Half::of(middle).bits == bits + (bits & 1));
    REQUIRE(Half::of(std::nextafter(middle, 0.0f)).bits == bits);
    REQUIRE(Half::of(std::nextafter(middle, 1e9f)).bits == bits + 1);
  }
  CHECK(Half::of(65520).bits == 0x7c00);
  CHECK(Half::of(-1).bits == 0xbc00);
}

TEST_CASE("poses: a quaternion, Euler angles and look_at agree") {
  const double angle = 0.7;
  const Pose a = Pose::wxyz({1, 2, 3}, {std::cos(angle / 2), 0, 0, std::sin(angle / 2)});
  const Pose b = Pose::euler({1, 2, 3}, {0, 0, angle});
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < 4; ++j)
      CHECK(a.matrix(i, j) == Approx(b.matrix(i, j)).margin(1e-12));
  const Pose camera = look_at({0, -3, 0}, {0, 0, 0});
  CHECK(camera.matrix(1, 2) == Approx(-1));  // -Z looks along +Y
  CHECK(camera.matrix(2, 1) == Approx(1));   // +Y of the image is up
  CHECK(error_of([] { look_at({1, 1, 1}, {1, 1, 1}); }).field() == "at");
  CHECK(error_of([] { Pose::wxyz({}, {0, 0, 0, 0}); }).field() == "wxyz");
}

TEST_CASE("uniform motion gets a key at least every 60 degrees") {
  const Keys keys = moving(Pose(), {0, 1}, {{1, 0, 0}, {0, 0, 3.2}});
  CHECK(keys.size() == 5);
  CHECK(keys.at(1).position().x == Approx(1));
  CHECK(keys.at(1).matrix(0, 0) == Approx(std::cos(3.2)));
}

TEST_CASE("a remedy is what stands behind the first semicolon") {
  CHECK(ClientError(Code::kAborted, "a: is b; do c; or d").remedy() == "do c; or d");
  CHECK(ClientError(Code::kAborted, "no more").remedy() == "no more");
  CHECK(name_of(Code::kFailedPrecondition) == "FAILED_PRECONDITION");
}
