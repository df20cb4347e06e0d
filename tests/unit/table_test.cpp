#include "renderer/scene/table.h"

#include "tests/unit/catch.h"

using namespace heliograph;

TEST_CASE("table: a copy shares chunks and a write clones one") {
  Table<int> a;
  for (int i = 0; i < 1000; ++i) a.insert(i);
  Table<int> b = a;
  b.write(300) = -1;
  CHECK(a.at(300) == 300);
  CHECK(b.at(300) == -1);
  int changed = 0;
  b.for_each_changed(a, [&](u32 i) {
    ++changed;
    CHECK(i / 256 == 1);
  });
  CHECK(changed == 256);
}

TEST_CASE("table: a chunk of another's rows holds them, and a write has its own") {
  auto owner = std::make_shared<std::vector<int>>(256, 7);
  const std::weak_ptr<std::vector<int>> is_there = owner;
  ChunkedArray<int> a;
  for (int i = 0; i < 300; ++i) a.push_back(i);
  const ChunkedArray<int> before = a;
  a.put_chunk(0, *owner, owner);
  const int* rows = owner->data();
  owner.reset();
  CHECK(a.chunk(0).data() == rows);
  CHECK((a[255] == 7 && a[256] == 256 && before[255] == 255));
  a.write(3) = 1;
  CHECK(is_there.expired());
  CHECK((a[3] == 1 && a[4] == 7));
  a.push_back(300);
  CHECK((a[300] == 300 && before.size() == 300));
}

TEST_CASE("table: an erased index comes back under a new version") {
  Table<int> t;
  const u32 i = t.insert(7);
  const u32 v = t.version(i);
  t.erase(i);
  CHECK(t.find(v, i) == nullptr);
  const u32 j = t.insert(8);
  CHECK(j == i);
  CHECK(t.find(v, j) == nullptr);
  CHECK(*t.find(t.version(j), j) == 8);
}

TEST_CASE("table: appending to a shared last chunk leaves the copy as it was") {
  Table<int> a;
  for (int i = 0; i < 10; ++i) a.insert(i);
  Table<int> b = a;
  b.insert(10);
  CHECK(a.count() == 10);
  CHECK(a.capacity() == 10);
  CHECK_FALSE(a.alive(10));
  CHECK(b.at(10) == 10);
  Table<int> c = a;
  c.insert(-1);
  CHECK(b.at(10) == 10);
  CHECK(c.at(10) == -1);
}

TEST_CASE("table: whole chunks at the border") {
  Table<int> a;
  for (int i = 0; i < 256; ++i) a.insert(i);
  const Table<int> b = a;
  a.insert(256);
  CHECK(a.capacity() == 257);
  int changed = 0;
  a.for_each_changed(b, [&](u32 i) {
    ++changed;
    CHECK(i == 256);
  });
  CHECK(changed == 1);
  CHECK_FALSE(a.same(b));
}

TEST_CASE("table: indices that are free are used again, the last one first, in each copy") {
  Table<int> a;
  for (int i = 0; i < 5; ++i) a.insert(i);
  a.erase(1);
  a.erase(3);
  Table<int> b = a;
  CHECK(a.insert(10) == 3);
  CHECK(a.insert(11) == 1);
  CHECK(a.insert(12) == 5);
  CHECK(b.insert(20) == 3);
  CHECK(a.at(3) == 10);
  CHECK(b.at(3) == 20);
  std::vector<u32> alive;
  b.for_each([&](u32 i, int) { alive.push_back(i); });
  CHECK(alive == std::vector<u32>{0, 2, 3, 4});
}

TEST_CASE("table: an erased row lets go of what it held") {
  Table<std::shared_ptr<int>> a;
  const auto held = std::make_shared<int>(1);
  a.insert(held);
  Table<std::shared_ptr<int>> b = a;
  CHECK(held.use_count() == 2);
  a.erase(0);
  CHECK(held.use_count() == 2);  // the copy still has it
  b = {};
  CHECK(held.use_count() == 1);
}

TEST_CASE("table: an index whose versions are used up is never used again") {
  Table<int> a;
  u32 last = a.insert(0);
  for (u32 use = 1; use < 0xffffff; ++use) {
    a.erase(0);
    last = a.insert(0);
  }
  CHECK(last == 0);
  CHECK(a.version(0) == 0xffffff);
  a.erase(0);
  CHECK(a.insert(0) == 1);
  CHECK_FALSE(a.find(0xffffff, 0));
  CHECK(a.count() == 1);
}
