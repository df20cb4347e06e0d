#include "renderer/base/boxed.h"

#include <optional>
#include <string>

#include "tests/unit/catch.h"

using heliograph::Boxed;

TEST_CASE("boxed: a copy has a value of its own, a moved one has none") {
  Boxed<std::string> first = "one";
  Boxed<std::string> second = first;
  *second += " more";
  CHECK(*first == "one");
  CHECK(*second == "one more");
  second = first;
  CHECK(*second == "one");
  const Boxed<std::string> third = std::move(first);
  CHECK(*third == "one");
  CHECK_FALSE(first);  // NOLINT(bugprone-use-after-move): that is what is promised
  first.reset();
  first = third;
  CHECK(first->size() == 3);
}

TEST_CASE("boxed: absent, and an optional that is there and empty, are told apart") {
  Boxed<std::optional<int>> value;
  CHECK_FALSE(value.has_value());
  value.emplace(std::nullopt);
  REQUIRE(value.has_value());
  CHECK_FALSE(value->has_value());
  value = 3;
  CHECK(**value == 3);
  static_assert(sizeof(value) == sizeof(void*));
}
