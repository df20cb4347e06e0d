// Copies in device memory: made once, counted, and gone with the last that holds them.
#include "renderer/backend/cuda/mirror.h"

#include <array>

#include "tests/unit/catch.h"
#include "tests/unit/fake_driver.h"

using namespace heliograph;
using namespace heliograph::test;
using cuda::Context;
using cuda::Copies;
using cuda::Mirror;

TEST_CASE("mirror: an array is uploaded once for all that hold it, and the bytes are counted") {
  const std::array<u32, 3> first{1, 2, 3}, second{4, 5, 6};
  {
    const auto context = Context::create(fake_driver(), 0);
    REQUIRE(context);
    Mirror mirror(*context);
    CHECK((*context)->uploaded_bytes() == 0);
    {
      Copies one(mirror), other(mirror);
      const u32* at = one.of(first.data(), 3);
      REQUIRE(one.status());
      CHECK(std::equal(first.begin(), first.end(), at));
      CHECK((*context)->uploaded_bytes() == 12);
      CHECK(other.of(first.data(), 3) == at);
      CHECK((*context)->uploaded_bytes() == 12);
      (void)other.of(second.data(), 3);
      CHECK((*context)->uploaded_bytes() == 24);
      (void)other.of_own(std::span<const u32>(second));  // of nobody else
      CHECK((*context)->uploaded_bytes() == 36);
      CHECK(other.of<u32>(nullptr, 3) == nullptr);
      CHECK(other.of(first.data(), 0) == nullptr);
      CHECK((*context)->uploaded_bytes() == 36);
      CHECK(fake_allocations == 3);
    }
    CHECK(fake_allocations == 0);
    Copies again(mirror);
    (void)again.of(first.data(), 3);
    CHECK((*context)->uploaded_bytes() == 48);
  }
  CHECK(fake_allocations == 0);
}
