#include "renderer/scene/table.h"

#include "renderer/scene/persistent_map.h"
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

TEST_CASE("persistent map: copies are independent") {
  PersistentMap<u64, u64> a;
  for (u64 i = 0; i < 5000; ++i) a.set(i, i * i);
  auto b = a;
  for (u64 i = 0; i < 5000; i += 2) b.erase(i);
  b.set(1, 0);
  CHECK(a.size() == 5000);
  CHECK(b.size() == 2500);
  for (u64 i = 0; i < 5000; ++i) {
    REQUIRE(a.find(i));
    CHECK(*a.find(i) == i * i);
    CHECK((b.find(i) != nullptr) == (i % 2 == 1));
  }
  CHECK(*b.find(1) == 0);
}
