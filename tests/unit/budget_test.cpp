// Budgets, charges and rates; rates on a clock of the test's own.
#include "server/quota/budget.h"

#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
using namespace std::chrono_literals;

namespace {

std::shared_ptr<Budget> budget(u64 limit, std::shared_ptr<Budget> parent = nullptr) {
  return std::make_shared<Budget>(
      limit, Budget::RefusalText{"things", "remove some", "tenant_things"}, std::move(parent));
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
        "needs 4 things, 3 are available (7 of 10 are in use); remove some, or raise the limit "
        "tenant_things");
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

TEST_CASE("budget: no tenant takes the share of another") {
  const auto total = budget(80), a = budget(80, total), b = budget(80, total);
  REQUIRE(a->take(70));
  CHECK(a->take(1).error().available == 0);
  CHECK(b->take(10));
  CHECK(!b->take(1));
  a->give_back(70);
  CHECK(b->take(60));  // all but a's share
  CHECK(!b->take(1));
  CHECK(a->take(10));
}

TEST_CASE("budget: more tenants than parts have smaller shares, and one tenant has all") {
  const auto total = budget(80), a = budget(80, total);
  CHECK(a->take(80));
  a->give_back(80);
  std::vector<std::shared_ptr<Budget>> others;
  for (int i = 0; i < 15; ++i) others.push_back(budget(80, total));
  CHECK(!a->take(6));
  CHECK(a->take(5));
  for (const auto& other : others) CHECK(other->take(5));
}

TEST_CASE("budget: the full total refuses sessions, then uploads, then jobs, of who has most") {
  const auto total = budget(100), a = budget(100, total), b = budget(100, total);
  total->set_overload(std::make_shared<const Overload>(Overload::Options{}));
  const auto refused = [&](Work work) { return !a->admit(work); };
  REQUIRE(a->take(85));
  CHECK(!refused(Work::kSessions));
  REQUIRE(a->take(1));
  CHECK(refused(Work::kSessions));
  CHECK(!refused(Work::kUploads));
  REQUIRE(b->take(7));
  CHECK(refused(Work::kUploads));
  CHECK(!refused(Work::kJobs));
  REQUIRE(b->take(5));
  CHECK(refused(Work::kJobs));
  const Error error = a->admit(Work::kUploads).error();
  CHECK(error.code == Code::kResourceExhausted);
  CHECK(error.retry_seconds > 0);
  CHECK(error.needed == 1);
  CHECK(error.available == 0);
  CHECK(error.allowed == 92);
  CHECK(
      error.message.find("too full for uploads: 98 of 100 things are in use, 86 by this tenant") !=
      std::string::npos);
  for (const Work work : {Work::kSessions, Work::kUploads, Work::kJobs}) CHECK(b->admit(work));
}

TEST_CASE("budget: full memory refuses everybody, in the same order, and lets go again") {
  const auto total = budget(100), a = budget(100, total);
  u64 resident = 0;
  const auto overload = [&](u64 bytes) {
    resident = bytes;
    total->set_overload(std::make_shared<const Overload>(
        Overload::Options{.memory_bytes = 1000, .resident = [&resident] { return resident; }}));
  };
  overload(850);
  CHECK(a->admit(Work::kSessions));
  overload(921);
  CHECK(!a->admit(Work::kSessions));
  CHECK(!a->check_memory(Work::kUploads));
  CHECK(a->admit(Work::kJobs));
  const Error error = a->admit(Work::kUploads).error();
  CHECK(error.code == Code::kResourceExhausted);
  CHECK(error.retry_seconds > 0);
  CHECK(error.message.find("limit memory_bytes") != std::string::npos);
  overload(971);
  CHECK(!a->admit(Work::kJobs));
  overload(100);
  CHECK(a->admit(Work::kSessions));
}

TEST_CASE("budget: a charge is split, and both parts are given back") {
  const auto things = budget(10);
  {
    auto whole = Charge::take(things, 8);
    REQUIRE(whole);
    Charge part = whole->split(5);
    CHECK(part.amount() == 5);
    CHECK(whole->amount() == 3);
    CHECK(whole->split(9).amount() == 3);
    CHECK(things->used() == 5);
  }
  CHECK(things->used() == 0);
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
