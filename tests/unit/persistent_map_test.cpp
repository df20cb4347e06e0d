// PersistentMap: copies are independent, and the tree depends on its keys only.
#include "renderer/scene/persistent_map.h"

#include <map>
#include <random>
#include <string>

#include "tests/unit/catch.h"

using namespace heliograph;

namespace {

struct SameHash {
  std::size_t operator()(u32) const { return 42; }
};
struct FewHashes {
  std::size_t operator()(u32 key) const { return key % 3; }
};

template <class Map>
std::vector<u32> order(const Map& map) {
  std::vector<u32> keys;
  map.for_each([&](u32 key, u32) { keys.push_back(key); });
  return keys;
}

/// Random changes of one of several copies, each beside a std::map.
template <class Hash>
void compare_with_model(u32 seed) {
  std::mt19937 random(seed);
  std::vector<std::pair<PersistentMap<u32, u32, Hash>, std::map<u32, u32>>> copies(1);
  for (u32 step = 0; step < 4000; ++step) {
    auto& [map, model] = copies[random() % copies.size()];
    const u32 key = u32(random() % 200);
    if (random() % 2) {
      map.set(key, step);
      model[key] = step;
    } else {
      map.erase(key);
      model.erase(key);
    }
    if (step % 500 == 0) copies.push_back(copies[random() % copies.size()]);
  }
  for (const auto& [map, model] : copies) {
    REQUIRE(map.size() == model.size());
    for (u32 key = 0; key < 200; ++key) {
      const auto expected = model.find(key);
      const u32* found = map.find(key);
      REQUIRE((found != nullptr) == (expected != model.end()));
      if (found) REQUIRE(*found == expected->second);
    }
    std::map<u32, u32> visited;
    map.for_each([&](u32 key, u32 value) { visited[key] = value; });
    REQUIRE(visited == model);
  }
}

}  // namespace

TEST_CASE("persistent map: does what std::map does, in every copy") {
  for (u32 seed = 0; seed < 5; ++seed) {
    compare_with_model<std::hash<u32>>(seed);
    compare_with_model<FewHashes>(seed);
    compare_with_model<SameHash>(seed);
  }
}

TEST_CASE("persistent map: iteration order depends on the keys only") {
  PersistentMap<u32, u32> up, down;
  for (u32 k = 0; k < 500; ++k) up.set(k, k);
  for (u32 k = 2000; k-- > 0;) down.set(k, 0);
  for (u32 k = 500; k < 2000; ++k) down.erase(k);
  CHECK(order(up) == order(down));
  PersistentMap<u32, u32> few;
  for (u32 k = 0; k < 5; ++k) few.set(k, k);
  for (u32 k = 5; k < 500; ++k) up.erase(k);
  CHECK(order(up) == order(few));
}

TEST_CASE("persistent map: empty, absent, and the last one") {
  PersistentMap<std::string, u32> map;
  CHECK(map.size() == 0);
  CHECK_FALSE(map.find(""));
  map.erase("nothing");
  map.set("", 1);
  REQUIRE(map.find(""));
  const auto copy = map;
  map.set("", 2);
  CHECK(*copy.find("") == 1);
  map.erase("");
  CHECK(map.size() == 0);
  CHECK(copy.size() == 1);
}
