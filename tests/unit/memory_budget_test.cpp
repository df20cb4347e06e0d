// A device's memory: what fits, what makes room, and what the driver is asked.
#include "renderer/backend/cuda/memory_budget.h"

#include <array>

#include "renderer/backend/cuda/mirror.h"
#include "renderer/backend/cuda/recent.h"
#include "tests/unit/catch.h"
#include "tests/unit/fake_driver.h"

using namespace heliograph;
using namespace heliograph::test;
using cuda::Context;
using cuda::Copies;
using cuda::MemoryBudget;
using cuda::Mirror;
using cuda::Recent;

namespace {

/// Bytes in use as long as it lives.
struct Held {
  MemoryBudget& budget;
  u64 bytes;
  ~Held() { budget.give_back(bytes); }
};
using Until = Recent<Held>::Until;

struct Stage {
  explicit Stage(u64 budget) {
    fake_reserved = fake_trims = fake_failures = 0;
    context = *Context::create(fake_driver(), 0, budget);
  }
  std::shared_ptr<Context> context;
};

constexpr u64 kKiB = 1024;

}  // namespace

TEST_CASE("device memory: what does not fit is refused with what is needed and what there is") {
  MemoryBudget budget(100);
  REQUIRE(budget.take(60));
  CHECK(budget.take(40));
  budget.give_back(40);
  const Status refused = budget.take(41);
  REQUIRE_FALSE(refused);
  CHECK(refused.error().code == Code::kResourceExhausted);
  CHECK((refused.error().needed == 41 && refused.error().available == 40));
  CHECK(refused.error().message.find("--device-memory") != std::string::npos);
  CHECK(budget.used() == 60);
  CHECK_FALSE(budget.take(~u64(0)));
  budget.give_back(60);
  CHECK(budget.take(100));
}

TEST_CASE("device memory: the oldest that nobody uses makes room, and only as many as it takes") {
  MemoryBudget budget(100);
  Recent<Held> recent(8);
  budget.set_give_up([&] { return recent.drop_unused(); });
  const auto make = [&](u64 bytes) {
    REQUIRE(budget.take(bytes));
    auto made = std::make_shared<const Held>(budget, bytes);
    recent.keep(made, Until::kOthersCame);
    return made;
  };
  const auto find = [&](u64 bytes) {
    return recent.find([&](const Held& each) { return each.bytes == bytes; });
  };
  for (const u64 bytes : {20, 21, 22, 23}) (void)make(bytes);
  const auto used = make(10);
  REQUIRE(find(20));  // from now on the latest
  REQUIRE(budget.take(30));
  CHECK((!find(21) && !find(22)));
  CHECK((find(23) && find(20) && find(10)));
  CHECK(budget.used() == 83);
  budget.give_back(30);
  CHECK_FALSE(budget.take(101));  // would never fit
  CHECK((find(23) && find(20)));
  CHECK_FALSE(budget.take(91));  // not beside what is used
  CHECK((!find(23) && !find(20) && find(10)));
  CHECK(budget.used() == 10);
}

TEST_CASE("device memory: where too many are kept the oldest goes, and lives while it is used") {
  MemoryBudget budget(100);
  Recent<Held> recent(2);
  REQUIRE(budget.take(30));
  const auto first = std::make_shared<const Held>(budget, 10);
  recent.keep(first, Until::kOthersCame);
  for (int i = 0; i < 2; ++i)
    recent.keep(std::make_shared<const Held>(budget, 10), Until::kOthersCame);
  CHECK_FALSE(recent.find([&](const Held& each) { return &each == first.get(); }));
  CHECK(budget.used() == 30);
  CHECK(recent.drop_unused());
  CHECK(recent.drop_unused());
  CHECK_FALSE(recent.drop_unused());
  CHECK(budget.used() == 10);
}

TEST_CASE("device memory: what is kept until it is dropped stays, however many others come") {
  MemoryBudget budget(100);
  Recent<Held> recent(2);
  REQUIRE(budget.take(60));
  const auto make = [&](Until until) {
    auto made = std::make_shared<const Held>(budget, 10);
    (void)recent.keep(made, until);
    return made.get();
  };
  const Held* stays = make(Until::kDropped);
  const auto is_it = [&](const Held& each) { return &each == stays; };
  for (int i = 0; i < 5; ++i) (void)make(Until::kOthersCame);
  CHECK(budget.used() == 30);
  CHECK(recent.find(is_it));
  CHECK(recent.drop(is_it).get() == stays);
  CHECK_FALSE(recent.drop(is_it));
  CHECK(budget.used() == 20);
}

TEST_CASE("device memory: the driver is not asked for more than the budget, and its pool shrinks") {
  Stage stage(100 * kKiB);
  Context& context = *stage.context;
  CHECK(context.budget().bytes() == 100 * kKiB);
  {
    const auto most = context.allocate(90 * kKiB);
    REQUIRE(most);
    const auto refused = context.allocate(11 * kKiB);
    REQUIRE_FALSE(refused);
    CHECK(refused.error().needed == 11 * kKiB);
    CHECK(refused.error().available == 10 * kKiB);
    CHECK((fake_allocations == 1 && fake_trims == 0));
    CHECK_FALSE(context.is_lost());
    CHECK(context.allocate(1));  // rounded to what the driver gives
    CHECK(fake_reserved == 90 * kKiB + 1);
  }
  CHECK(context.budget().used() == 0);
  CHECK(context.allocate(9 * kKiB));
  CHECK(fake_trims == 0);  // 90 KiB in the pool and 9 more
  CHECK(context.allocate(50 * kKiB));
  CHECK(fake_trims == 1);
  CHECK(fake_reserved == 50 * kKiB);
}

TEST_CASE("device memory: without a setting it is nine tenths of what is free") {
  const Stage stage(0);
  CHECK(stage.context->budget().bytes() == (1u << 30) / 10 * 9);
}

TEST_CASE("device memory: a driver that has none left costs the call, not the device") {
  Stage stage(100 * kKiB);
  Context& context = *stage.context;
  int given_up = 0;
  context.budget().set_give_up([&] { return given_up++ < 3; });
  fake_failures = 1;
  CHECK(context.allocate(kKiB));  // once others' memory is given up
  CHECK((given_up == 4 && fake_trims == 1));
  fake_failures = 2;
  const auto refused = context.allocate(kKiB);
  REQUIRE_FALSE(refused);
  CHECK(refused.error().code == Code::kResourceExhausted);
  CHECK((refused.error().needed == kKiB && refused.error().available == 1u << 30));
  CHECK(context.budget().used() == 0);
  CHECK_FALSE(context.is_lost());
  CHECK(context.allocate(kKiB));
}

TEST_CASE("device memory: a refused scene says what it needs in all") {
  Stage stage(1000 * kKiB);
  Mirror mirror(stage.context);
  static const std::array<std::byte, 900 * kKiB> arrays{};
  const std::span all(arrays);
  Copies other(mirror);
  (void)other.of(all.data(), 300 * kKiB);
  {
    Copies copies(mirror);
    (void)copies.of(all.data(), 300 * kKiB);  // is there already
    (void)copies.of(all.data(), 200 * kKiB);
    (void)copies.of_own(all.first(100 * kKiB));
    (void)copies.of(all.data(), 600 * kKiB);
    (void)copies.of(all.data(), 300 * kKiB);
    (void)copies.of_own(all.first(50 * kKiB));
    (void)copies.of(all.data(), 70 * kKiB);
    const Status refused = copies.finish();
    REQUIRE_FALSE(refused);
    CHECK(refused.error().needed == (200 + 100 + 600 + 50 + 70) * kKiB);
    CHECK(refused.error().available == 700 * kKiB);
  }
  CHECK(stage.context->budget().used() == 300 * kKiB);
  CHECK(other.finish());
}
