// Errands beside the devices: what is short waits for nothing long, and the same is done once.
#include "renderer/schedule/workers.h"

#include <future>
#include <vector>

#include "tests/unit/catch.h"

using namespace heliograph;

namespace {

using Group = Workers::Group;

/// Errands that somebody waits for.
struct Waiting {
  std::promise<void> promise;
  std::shared_ptr<Group> group = std::make_shared<Group>([this] { promise.set_value(); });
  std::future<void> done = promise.get_future();

  [[nodiscard]] bool is_done() const {
    return done.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  }
};

std::vector<Errand> errands(double seconds, std::function<void()> run, u64 key = 0) {
  return {{.key = {key}, .seconds = seconds, .run = [run = std::move(run)](const Interrupt&) {
             run();
           }}};
}

/// Work that runs until it is let go.
struct Held {
  explicit Held(Workers& workers, double seconds = 10) {
    workers.run(waiting.group, {.tenant = 1},
                errands(seconds,
                        [this] {
                          began.set_value();
                          go.get_future().wait();
                        }),
                nullptr);
    began.get_future().wait();
  }
  void end() {
    go.set_value();
    waiting.done.wait();
  }
  Waiting waiting;
  std::promise<void> began, go;
};

}  // namespace

TEST_CASE("workers: short errands are done while a long one runs and others wait") {
  Workers workers({.threads = 1});
  Held held(workers);
  Waiting second, small;
  workers.run(second.group, {.tenant = 2}, errands(10, [] {}), nullptr);
  workers.run(small.group, {.tenant = 1}, errands(1e-3, [] {}), nullptr);
  small.done.wait();
  CHECK_FALSE(held.waiting.is_done());
  CHECK_FALSE(second.is_done());
  held.end();
  second.done.wait();
}

TEST_CASE("workers: medium errands go one by one, and wait for no long one") {
  const bool is_alone = GENERATE(true, false);
  Workers workers({.threads = 2, .is_alone = [is_alone](const Origin&) { return is_alone; }});
  Held held(workers), medium(workers, 0.5);
  Waiting second, small;
  workers.run(second.group, {.tenant = 2}, errands(0.5, [] {}), nullptr);
  workers.run(small.group, {.tenant = 2}, errands(1e-3, [] {}), nullptr);
  small.done.wait();
  CHECK_FALSE(second.is_done());
  medium.end();
  second.done.wait();
  CHECK_FALSE(held.waiting.is_done());
  held.end();
}

TEST_CASE("workers: tenants take turns, whoever asked first and for how much") {
  Workers workers({.threads = 1, .credit = 0, .turn = 0});
  Held held(workers);
  std::vector<u64> order;
  std::vector<std::unique_ptr<Waiting>> all;
  for (const u64 tenant : {1, 1, 1, 1, 2}) {
    all.push_back(std::make_unique<Waiting>());
    workers.run(all.back()->group, {.tenant = tenant},
                errands(10, [&order, tenant] { order.push_back(tenant); }), nullptr);
  }
  held.end();
  for (const auto& each : all) each->done.wait();
  CHECK(order == std::vector<u64>{2, 1, 1, 1, 1});
}

TEST_CASE("workers: what several want is done once, and all of them go on") {
  Workers workers({.threads = 1});
  Held held(workers);
  u32 times = 0;
  Waiting a, b, twice;
  const auto count = [&] { ++times; };
  workers.run(a.group, {.tenant = 1}, errands(10, count, 7), nullptr);
  workers.run(b.group, {.tenant = 2}, errands(10, count, 7), nullptr);
  auto two = errands(10, count, 7);
  two.push_back(errands(10, count, 8).front());
  workers.run(twice.group, {.tenant = 3}, std::move(two), nullptr);
  held.end();
  a.done.wait();
  b.done.wait();
  twice.done.wait();
  CHECK(times == 2);
}

TEST_CASE("workers: who gives up waits for what runs for it alone, and for nothing else") {
  Workers workers({.threads = 1});
  Held held(workers);
  bool is_run = false;
  Waiting waits, shares, stays;
  workers.run(waits.group, {}, errands(10, [&] { is_run = true; }), nullptr);
  workers.run(shares.group, {}, errands(10, [] {}, 7), nullptr);
  workers.run(stays.group, {}, errands(10, [] {}, 7), nullptr);
  workers.abandon(waits.group);
  workers.abandon(shares.group);
  workers.abandon(held.waiting.group);
  CHECK(waits.is_done());
  CHECK(shares.is_done());
  CHECK_FALSE(held.waiting.is_done());
  CHECK_FALSE(stays.is_done());
  held.end();
  stays.done.wait();
  CHECK_FALSE(is_run);
}

TEST_CASE("workers: what nobody waits for any more is interrupted, and done anew for who comes") {
  Workers workers({.threads = 2});
  Waiting a, b, late;
  std::promise<void> began;
  std::promise<bool> ended;
  const auto until_interrupted = [&](const Interrupt& interrupt) {
    began.set_value();
    while (!interrupt.requested()) std::this_thread::yield();
    ended.set_value(true);
  };
  for (const auto& group : {a.group, b.group})
    workers.run(group, {}, {{.key = {7}, .seconds = 0.1, .run = until_interrupted}}, nullptr);
  began.get_future().wait();
  workers.abandon(a.group);
  auto is_ended = ended.get_future();
  CHECK(is_ended.wait_for(std::chrono::milliseconds(20)) == std::future_status::timeout);
  workers.abandon(b.group);
  is_ended.wait();
  bool is_made = false;
  workers.run(late.group, {}, errands(0.1, [&] { is_made = true; }, 7), nullptr);
  late.done.wait();
  CHECK(is_made);
}

TEST_CASE("workers: what waits when they end is dropped, what runs ends") {
  Waiting dropped;
  std::unique_ptr<Held> held;
  {
    Workers workers({.threads = 1});
    held = std::make_unique<Held>(workers);
    workers.run(dropped.group, {}, errands(10, [] {}), nullptr);
    held->go.set_value();
  }
  CHECK(held->waiting.is_done());
}
