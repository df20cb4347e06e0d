// The order in which work gets the device, on a clock of the test's own.
#include "renderer/schedule/fair_queue.h"

#include <map>
#include <memory>
#include <optional>

#include "tests/unit/catch.h"

using namespace heliograph;

namespace {

constexpr double kSlice = 0.01;
constexpr double kCredit = 0.1;

constexpr auto kAny = [](const auto&) { return true; };

struct Item {
  u64 owner = 0;  // session
  double left = 0;
  double arrived = 0;
};

/// A device that runs slices of what the queue says. Seconds.
class Device {
 public:
  explicit Device(double turn = 0, double little = 0) : queue(kCredit, turn, little) {}

  void push(const Origin& origin, double seconds, bool is_short = false) {
    queue.push(origin, is_short, {origin.session, seconds, now});
  }
  /// One slice; the item, when that ended it.
  std::optional<Item> slice() {
    const auto turn = *queue.next(kAny);
    Item& item = turn.item();
    const double cost = std::min(kSlice, item.left);
    item.left -= cost;
    now += cost;
    used[item.owner] += cost;
    queue.charge(turn, cost);
    if (item.left > 1e-9) return std::nullopt;
    return queue.pop(turn);
  }
  void run(double seconds) {
    for (const double end = now + seconds; now < end - 1e-9 && !queue.empty();) slice();
  }

  FairQueue<Item> queue;
  double now = 0;
  std::map<u64, double> used;  // by session
};

Origin of(u64 tenant, u64 session, double weight = 1, i32 priority = 0) {
  return {.tenant = tenant, .weight = weight, .session = session, .priority = priority};
}

}  // namespace

TEST_CASE("fair queue: equals get equal shares, slice by slice") {
  Device device;
  for (const u64 session : {1, 2, 3, 4}) device.push(of(0, session), 10);
  device.run(4);
  for (const u64 session : {1, 2, 3, 4})
    CHECK(device.used[session] == Approx(1).margin(1.01 * kSlice));
}

TEST_CASE("fair queue: equals go on for a turn, and who used less does not wait for its end") {
  constexpr double kTurn = 0.05;
  Device device(kTurn);
  for (const u64 session : {1, 2, 3, 4}) device.push(of(0, session), 10);
  u32 changes = 0;
  u64 last = 0;
  while (device.now < 4) {
    const u64 owner = device.queue.next(kAny)->item().owner;
    changes += owner != last ? 1 : 0;
    last = owner;
    device.slice();
  }
  CHECK(changes <= 4 / kTurn + 4);
  for (const u64 session : {1, 2, 3, 4})
    CHECK(device.used[session] == Approx(1).margin(kTurn + kSlice));

  device.push(of(0, 5), 0.03);
  device.run(0.03);
  CHECK(device.used[5] == Approx(0.03));
}

TEST_CASE("fair queue: who asks again and again waits for nobody's turn") {
  constexpr double kTurn = 0.05, kFrame = 0.002;
  Device device(kTurn);
  device.push(of(0, 1), 100);
  device.run(1);
  device.push(of(0, 2), kFrame);
  double longest = 0;
  while (device.now < 3) {
    const auto ended = device.slice();
    if (!ended) continue;
    longest = std::max(longest, device.now - ended->arrived);
    device.push(of(0, 2), kFrame);
  }
  CHECK(longest <= kFrame + 1.01 * kSlice);
}

TEST_CASE("fair queue: who has had little yet waits for nobody's turn, also after a slice") {
  const double little = GENERATE(0.0, 2 * kSlice);
  Device device(50 * kSlice, little);
  device.push(of(0, 1), 100 * kSlice);
  device.slice();
  device.push(of(0, 2), 1.5 * kSlice);
  device.slice();
  device.push(of(0, 3), 100 * kSlice);  // one that is new
  device.run(4 * kSlice);
  CHECK((device.used[2] > 1.1 * kSlice) == (little > 0));
}

TEST_CASE("fair queue: who comes back from elsewhere shares evenly from then on") {
  Device device;
  device.push(of(0, 1), 100);
  device.run(5);
  device.queue.push(of(0, 2), false, {2, 100, device.now}, true);
  device.run(1);
  CHECK(device.used[2] == Approx(0.5).margin(1.01 * kSlice));
}

TEST_CASE("fair queue: one line is served in order") {
  Device device;
  for (const double seconds : {0.03, 0.02, 0.01}) device.push(of(0, 1), seconds);
  std::vector<double> ended;
  while (!device.queue.empty())
    if (device.slice()) ended.push_back(device.now);
  REQUIRE(ended.size() == 3);
  CHECK(ended[0] == Approx(0.03));
  CHECK(ended[1] == Approx(0.05));
  CHECK(ended[2] == Approx(0.06));
}

TEST_CASE("fair queue: scenes of one session share evenly, and none waits for another's end") {
  Device device;
  for (const double seconds : {10., 10.}) device.push({.session = 1, .scene = 1}, seconds);
  device.run(1);
  device.push({.session = 1, .scene = 2}, 0.02);
  device.run(0.02);
  CHECK(device.queue.size() == 2);
}

TEST_CASE("fair queue: tenants share by weight, whatever the number of their sessions") {
  Device device;
  for (u64 session = 1; session <= 9; ++session) device.push(of(1, session), 100);
  device.push(of(2, 100, 2), 100);
  device.run(9);
  CHECK(device.used[100] == Approx(6).margin(2 * kSlice));
  for (u64 session = 1; session <= 9; ++session)
    CHECK(device.used[session] == Approx(1.0 / 3).margin(2 * kSlice));
}

TEST_CASE("fair queue: who comes back goes first, for the credit only") {
  Device device;
  device.push(of(0, 1), 100);
  device.run(5);
  device.push(of(0, 2), 100);
  device.run(kCredit);
  CHECK(device.used[2] == Approx(kCredit).margin(1.01 * kSlice));
  device.run(10);
  CHECK(device.used[2] == Approx(5 + kCredit).margin(2 * kSlice));  // idle time was not saved up
}

TEST_CASE("fair queue: asking again at once gains nothing") {
  Device device;
  device.push(of(0, 1), 100);
  device.push(of(0, 2), 0.005);
  while (device.now < 10)
    if (const auto ended = device.slice()) device.push(of(0, ended->owner), 0.005);
  CHECK(device.used[2] == Approx(5).margin(kCredit));
}

TEST_CASE("fair queue: a higher priority goes first in its tenant, and not before others") {
  Device device;
  device.push(of(1, 1, 1, 0), 100);
  device.push(of(1, 2, 1, 5), 1);
  device.push(of(2, 3, 1, -100), 100);
  device.run(2);
  CHECK(device.used[1] == 0);
  CHECK(device.used[2] == Approx(1).margin(2 * kSlice));
  CHECK(device.used[3] == Approx(1).margin(2 * kSlice));
  device.run(2);
  CHECK(device.used[1] == Approx(1).margin(2 * kSlice));
}

TEST_CASE("fair queue: labels do not wait behind beauty, and leave it its half") {
  Device device;
  for (u64 session = 1; session <= 10; ++session) device.push(of(0, session), 100);
  device.run(5);
  device.push(of(0, 1), 0.008, true);  // of a session whose beauty runs
  const auto ended = device.slice();
  REQUIRE(ended.has_value());
  CHECK(ended->arrived == Approx(device.now - 0.008));

  device.push(of(0, 11), 100, true);
  device.run(10);
  CHECK(device.used[11] == Approx(5).margin(kCredit + 2 * kSlice));
}

TEST_CASE("fair queue: a noisy tenant does not slow another one down") {
  // A quarter of the device in jobs of 30 ms, alone and beside a tenant with ten endless sessions.
  constexpr double kSeconds = 0.03, kEvery = 0.12;
  Device device;
  for (u64 session = 1; session <= 10; ++session) device.push(of(1, session), 1e6);
  device.run(3);
  std::vector<double> took;
  for (double next = device.now; took.size() < 200;) {
    if (device.now >= next) {
      device.push(of(2, 100), kSeconds);
      next += kEvery;
    }
    if (const auto ended = device.slice()) took.push_back(device.now - ended->arrived);
  }
  std::ranges::sort(took);
  CHECK(took[took.size() * 99 / 100] <= 1.5 * kSeconds);
}

TEST_CASE("fair queue: what is taken out is gone, the others go on") {
  Device device;
  for (const u64 session : {1, 2, 3}) {
    device.push(of(0, session), 1);
    device.push(of(0, session), 2);
  }
  device.run(0.1);
  auto taken = device.queue.take_if([](const Item& item) { return item.owner == 2; });
  CHECK(taken.size() == 2);
  CHECK(device.queue.size() == 4);
  device.run(100);
  CHECK(device.queue.empty());
  CHECK(device.used[1] == Approx(3));
  CHECK(device.used[3] == Approx(3));
  CHECK(device.used[2] < 0.1);
}

TEST_CASE("fair queue: items may own things") {
  FairQueue<std::unique_ptr<int>> queue(kCredit, 0, 0);
  queue.push({}, false, std::make_unique<int>(7));
  const auto turn = *queue.next(kAny);
  CHECK(*turn.item() == 7);
  queue.charge(turn, 1);
  CHECK(*queue.pop(turn) == 7);
  CHECK(queue.empty());
  CHECK(queue.take_if([](const auto&) { return true; }).empty());
}

TEST_CASE("fair queue: who may not is passed over, and those behind it are not") {
  FairQueue<Item> queue(kCredit, 0, 0);
  for (const u64 session : {1, 1, 2}) queue.push(of(0, session), false, {session, 1, 0});
  const auto turn = *queue.next(kAny);
  CHECK(turn.item().owner == 1);
  const auto another = queue.next([&](const Item& item) { return &item != &turn.item(); });
  CHECK(another->item().owner == 1);
  CHECK(queue.next([](const Item& item) { return item.owner == 2; })->item().owner == 2);
  CHECK_FALSE(queue.next([](const Item&) { return false; }));
  queue.charge(turn, 1);
  CHECK(queue.next(kAny)->item().owner == 2);
  queue.pop(turn);
  CHECK(queue.size() == 2);
}
