// Ranges of a piece of memory: none overlaps another, neighbours join, a random history against a
// map of bytes.
#include "server/store/ranges.h"

#include <random>
#include <vector>

#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

TEST_CASE("ranges: the smallest free range that will do is cut") {
  Ranges ranges(1000);
  CHECK(ranges.take(100) == 0u);
  CHECK(ranges.take(300) == 100u);
  CHECK(ranges.take(100) == 400u);
  ranges.give_back(0, 100);
  ranges.give_back(100, 300);  // joins
  CHECK(ranges.count() == 2);
  CHECK(ranges.take(450) == 500u);
  CHECK(ranges.take(50) == 950u);
  CHECK_FALSE(ranges.take(401));
  CHECK(ranges.take(400) == 0u);
  CHECK_FALSE(ranges.take(1));
  CHECK(ranges.count() == 0);
}

TEST_CASE("ranges: what came back joins its neighbours on both sides") {
  Ranges ranges(300);
  for (const u64 offset : {0u, 100u, 200u}) REQUIRE(ranges.take(100) == offset);
  ranges.give_back(0, 100);
  ranges.give_back(200, 100);
  CHECK_FALSE(ranges.take(101));
  CHECK(ranges.count() == 2);
  ranges.give_back(100, 100);
  CHECK(ranges.count() == 1);
  CHECK(ranges.take(300) == 0u);
}

TEST_CASE("ranges: of equal ones the first") {
  Ranges ranges(500);
  for (int i = 0; i < 5; ++i) (void)ranges.take(100);
  ranges.give_back(300, 100);
  ranges.give_back(100, 100);
  CHECK(ranges.take(100) == 100u);
  CHECK(ranges.take(100) == 300u);
}

TEST_CASE("ranges: no two uses overlap in a random history") {
  constexpr u64 kSize = 4096;
  Ranges ranges(kSize);
  std::vector<bool> used(kSize);
  std::vector<std::pair<u64, u64>> taken;
  std::minstd_rand dice(1);
  u64 refused = 0;
  for (int i = 0; i < 20'000; ++i) {
    const u64 bytes = 1 + dice() % (i % 7 == 0 ? 500 : 60);
    if (const auto offset = dice() % 5 < 3 ? ranges.take(bytes) : std::nullopt) {
      REQUIRE(*offset + bytes <= kSize);
      for (u64 k = *offset; k < *offset + bytes; ++k) REQUIRE_FALSE(used[k]);
      std::fill_n(used.begin() + i64(*offset), bytes, true);
      taken.emplace_back(*offset, bytes);
    } else if (!taken.empty()) {
      ++refused;
      std::swap(taken[dice() % taken.size()], taken.back());
      const auto [from, size] = taken.back();
      taken.pop_back();
      std::fill_n(used.begin() + i64(from), size, false);
      ranges.give_back(from, size);
    }
  }
  CHECK(refused > 1000);
  for (const auto& [offset, bytes] : taken) ranges.give_back(offset, bytes);
  CHECK(ranges.count() == 1);
  CHECK(ranges.take(kSize) == 0u);
}
