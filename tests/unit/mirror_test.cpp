// Copies in device memory: made once, counted, and gone with the last that holds them.
#include "renderer/backend/cuda/mirror.h"

#include <array>
#include <numeric>
#include <thread>
#include <vector>

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
      REQUIRE(one.finish());
      CHECK(std::equal(first.begin(), first.end(), at));
      CHECK((*context)->uploaded_bytes() == 12);
      CHECK(other.of(first.data(), 3) == at);
      CHECK((*context)->uploaded_bytes() == 12);
      (void)other.of(second.data(), 3);
      CHECK((*context)->uploaded_bytes() == 24);
      CHECK(other.of<u32>(nullptr, 3) == nullptr);
      CHECK(other.of(first.data(), 0) == nullptr);
      CHECK((*context)->uploaded_bytes() == 24);
      CHECK(fake_allocations == 2);
    }
    CHECK(fake_allocations == 0);
    Copies again(mirror);
    (void)again.of(first.data(), 3);
    CHECK((*context)->uploaded_bytes() == 36);
  }
  CHECK(fake_allocations == 0);
}

TEST_CASE("mirror: small arrays of nobody else lie together, and are there in the end") {
  {
    const auto context = Context::create(fake_driver(), 0);
    REQUIRE(context);
    Mirror mirror(*context);
    Copies copies(mirror);
    const auto own = [&](const std::vector<u32>& array) {
      return std::pair(array, copies.of_own(std::span<const u32>(array)));
    };
    const auto numbers = [](u32 first, u32 count) {
      std::vector<u32> array(count);
      std::iota(array.begin(), array.end(), first);
      return array;
    };
    std::vector<std::pair<std::vector<u32>, const u32*>> made;
    made.push_back(own(numbers(1, 3)));
    made.push_back(own(numbers(100, 1000)));
    CHECK((*context)->uploaded_bytes() == 0);
    CHECK(fake_allocations == 1);
    made.push_back(own(numbers(5, 100'000)));  // too large: it goes at once
    CHECK((*context)->uploaded_bytes() == 400'000);
    CHECK(fake_allocations == 2);
    for (u32 i = 0; i < 30; ++i) made.push_back(own(numbers(i, 4000)));
    CHECK(fake_allocations == 9);  // four in each chunk
    REQUIRE(copies.finish());
    CHECK((*context)->uploaded_bytes() > 400'000 + 30 * 16'000);
    for (const auto& [array, at] : made) {
      CHECK(std::equal(array.begin(), array.end(), at));
      CHECK(reinterpret_cast<std::uintptr_t>(at) % 16 == 0);
    }
  }
  CHECK(fake_allocations == 0);
}

TEST_CASE("mirror: of an array like one that is there only what differs is sent") {
  {
    const auto context = Context::create(fake_driver(), 0);
    REQUIRE(context);
    Mirror mirror(*context);
    Copies copies(mirror);
    using Row = std::array<u32, 50>;
    ChunkedArray<Row> before;
    for (u32 i = 0; i < 1000; ++i) before.push_back(Row{i});
    const Row* there = copies.of_own(before);
    const u64 sent = (*context)->uploaded_bytes();
    CHECK(sent == 200'000);
    ChunkedArray<Row> now = before;
    now.write(1)[49] = now.write(999)[0] = 1;
    (void)now.write(600);  // a chunk of its own with the same rows
    const Row* made = copies.of_changed(now, before, there);
    REQUIRE(copies.finish());
    CHECK(made != there);
    const auto is_copy = [](const ChunkedArray<Row>& rows, const Row* copy) {
      for (u32 i = 0; i < rows.size(); ++i)
        if (rows[i] != copy[i]) return false;
      return true;
    };
    CHECK(is_copy(now, made));
    CHECK(is_copy(before, there));
    CHECK((*context)->uploaded_bytes() - sent == 16'384 + 232 * sizeof(Row) % 16'384);
  }
  CHECK(fake_allocations == 0);
}

TEST_CASE("mirror: what is much goes through pinned memory, all of it to its place") {
  {
    const auto context = Context::create(fake_driver(), 0);
    REQUIRE(context);
    Mirror mirror(*context);
    Copies copies(mirror);
    using Row = std::array<u32, 50>;
    constexpr u32 kCount = 70'000;  // 14 MB: stages are used again
    ChunkedArray<Row> before;
    for (u32 i = 0; i < kCount; ++i) before.push_back(Row{i, 1});
    const Row* there = copies.of_own(before);
    ChunkedArray<Row> now = before;
    u64 changed = 0;
    for (u32 i = 0; i < kCount; ++i) {
      if (i / 256 % 5 == 2) continue;  // a gap
      now.write(i)[49] = i + 7;
      ++changed;
    }
    const u64 sent = (*context)->uploaded_bytes();
    const Row* made = copies.of_changed(now, before, there);
    REQUIRE(copies.finish());
    CHECK((*context)->uploaded_bytes() - sent == changed * sizeof(Row));
    for (u32 i = 0; i < kCount; ++i)
      if (made[i] != now[i] || there[i] != before[i]) FAIL("row " << i);
  }
  CHECK(fake_allocations == 0);
}

TEST_CASE("mirror: what is large arrives whole, from several threads at once") {
  {
    const auto context = Context::create(fake_driver(), 0);
    REQUIRE(context);
    std::vector<std::vector<u32>> arrays;
    for (const u32 count : {262'145u, 1'048'576u, 2'500'001u, 3'000'000u}) {
      arrays.emplace_back(count);
      std::iota(arrays.back().begin(), arrays.back().end(), count);
    }
    std::vector<cuda::DeviceMemory> copies;
    for (const auto& array : arrays)
      copies.push_back((*context)->allocate(4 * array.size()).value());
    std::vector<int> sent(arrays.size());
    {
      std::vector<std::jthread> threads;
      for (std::size_t i = 0; i < arrays.size(); ++i)
        threads.emplace_back([&, i] {
          sent[i] =
              (*context)->upload(copies[i].at(), std::as_bytes(std::span(arrays[i]))).has_value();
        });
    }
    for (std::size_t i = 0; i < arrays.size(); ++i) {
      REQUIRE(sent[i]);
      CHECK(std::equal(arrays[i].begin(), arrays[i].end(), copies[i].as<const u32>()));
    }
  }
  CHECK(fake_allocations == 0);
}
