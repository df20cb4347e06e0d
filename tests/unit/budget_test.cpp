// Budgets, charges and rates; rates on a clock of the test's own.
#include "server/quota/budget.h"

#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
using namespace std::chrono_literals;

namespace {

std::shared_ptr<Budget> budget(u64 limit, std::shared_ptr<Budget> parent = nullptr) {
  return std::make_shared<Budget>(limit, Budget::Words{"things", "remove some", "tenant_things"},
                                  std::move(parent));
}

}  // namespace

TEST_CASE("budget: says what is needed, what there is, and which limit") {
  Budget things(10, {"things", "remove some", "tenant_things"});
  REQUIRE(things.take(7).has_value());
  const Status refused = things.take(4);
  REQUIRE(!refused.has_value());
  CHECK(refused.error().code == Code::kResourceExhausted);
  CHECK(refused.error().needed == 4);
  CHECK(refused.error().available == 3);
  CHECK(refused.error().message ==
        "needs 4 things, 3 are available; remove some, or raise the limit tenant_things");
  CHECK(things.used() == 7);
  things.give_back(7);
  CHECK(things.take(10).has_value());
}

TEST_CASE("budget: a part of another one takes from both or from none") {
  const auto whole = budget(10), part = budget(100, whole);
  REQUIRE(part->take(8).has_value());
  CHECK(whole->used() == 8);
  CHECK(!part->take(3).has_value());
  CHECK(part->used() == 8);
  CHECK(whole->used() == 8);
  part->give_back(8);
  CHECK(part->used() == 0);
  CHECK(whole->used() == 0);
}

TEST_CASE("budget: a lower limit refuses new work only, a higher one lets it in") {
  const auto things = budget(10);
  auto held = Charge::take(things, 8);
  REQUIRE(held);
  things->set_limit(5);
  CHECK(things->limit() == 5);
  CHECK(things->used() == 8);
  CHECK(things->take(1).error().available == 0);
  CHECK(held->resize(6));  // giving back is no new work
  CHECK(!held->resize(7));
  things->set_limit(12);
  CHECK(held->resize(12));
}

TEST_CASE("charge: goes back with its end, and changes its size") {
  const auto things = budget(10);
  {
    auto charge = Charge::take(things, 4);
    REQUIRE(charge.has_value());
    REQUIRE(charge->resize(9).has_value());
    CHECK(things->used() == 9);
    CHECK(!charge->resize(11).has_value());
    CHECK(things->used() == 9);
    REQUIRE(charge->resize(2).has_value());
    CHECK(things->used() == 2);
    Charge moved = std::move(*charge);
    moved = Charge();
    CHECK(things->used() == 0);
    REQUIRE(Charge::take(things, 10).has_value());
  }
  CHECK(things->used() == 0);
}

TEST_CASE("rate: ten seconds' worth at once, then the average") {
  const auto start = Rate::Clock::now();
  Rate rate(100, "things_per_second");
  u64 taken = 0;
  for (auto now = start; now < start + 100s; now += 10ms)
    if (rate.admit(now)) {
      rate.charge(5, now);
      taken += 5;
    }
  CHECK(taken == Approx(100 * (100 + 10)).margin(10));
}

TEST_CASE("rate: a debt is told, and over when it says") {
  const auto start = Rate::Clock::now() + 1s;
  Rate rate(100, "things_per_second");
  REQUIRE(rate.admit(start).has_value());
  rate.charge(1500, start);  // known only afterwards
  const Status refused = rate.admit(start);
  REQUIRE(!refused.has_value());
  CHECK(refused.error().code == Code::kResourceExhausted);
  CHECK(refused.error().retry_seconds == Approx(5).margin(0.05));
  CHECK(refused.error().message.find("things_per_second") != std::string::npos);
  CHECK(!rate.admit(start + 4900ms).has_value());
  CHECK(rate.admit(start + 5050ms).has_value());
}

TEST_CASE("rate: a new limit holds at once, and a debt takes the time that it took before") {
  const auto start = Rate::Clock::now() + 1s;
  Rate rate(100, "things_per_second");
  rate.charge(1500, start);
  for (const u64 limit : {1, 1000}) {
    rate.set_limit(limit);
    CHECK(rate.limit() == limit);
    CHECK(rate.admit(start).error().retry_seconds == Approx(5 + 1 / double(limit)).margin(0.05));
  }
  REQUIRE(rate.admit(start + 5100ms));
  rate.charge(2000, start + 5100ms);
  CHECK(rate.admit(start + 5100ms).error().retry_seconds == Approx(1.9).margin(0.05));
}
