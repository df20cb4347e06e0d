// What stands still is seen, told once, and told again when it moves.
#include "server/os/watchdog.h"

#include <fcntl.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "server/observe/stall_monitor.h"
#include "server/os/busy_times.h"
#include "server/os/work_pool.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
using std::chrono::milliseconds;

namespace {

void await(const auto& condition) {
  for (int i = 0; i < 1000 && !condition(); ++i) std::this_thread::sleep_for(milliseconds(5));
  REQUIRE(condition());
}

/// A loop that runs in a thread of its own, and what its watchdog says.
struct WatchedLoop {
  std::unique_ptr<EventLoop> loop = *EventLoop::create();
  const UniqueFd nowhere{::open("/dev/null", O_WRONLY | O_CLOEXEC)};
  const Log log{"off", false, {}, nowhere.get()};
  Watchdog watchdog{*loop, log, {.hang_seconds = 0.3, .stuck_seconds = 0.9}};
  std::mutex mutex;
  std::string fault;
  std::atomic<bool> is_live = true;
  std::atomic<int> looks = 0;
  std::thread thread;

  explicit WatchedLoop(std::vector<Watchdog::Part> parts = {}) {
    thread = std::thread([this] { loop->run(); });
    watchdog.start(std::move(parts), {.on_fault =
                                          [this](const std::string& now) {
                                            const std::lock_guard lock(mutex);
                                            fault = now;
                                          },
                                      .on_live = [this](bool live) { is_live = live; },
                                      .on_tick = [this](double) { ++looks; }});
  }
  ~WatchedLoop() {
    watchdog.stop();
    loop->quit();
    thread.join();
  }
  std::string told() {
    const std::lock_guard lock(mutex);
    return fault;
  }
};

}  // namespace

TEST_CASE("watchdog: a loop that stands still is neither ready nor, later, live, until it moves") {
  WatchedLoop watched;
  await([&] { return watched.looks > 3; });
  CHECK(watched.told().empty());
  std::atomic<bool> is_held = true;
  watched.loop->post([&] {
    while (is_held) std::this_thread::sleep_for(milliseconds(1));
  });
  await([&] { return watched.told().ends_with(": loop"); });
  CHECK(watched.is_live);
  await([&] { return !watched.is_live; });
  CHECK(watched.watchdog.still_seconds().at("loop") > 0.9);
  is_held = false;
  await([&] { return watched.is_live && watched.told().empty(); });
}

TEST_CASE("watchdog: parts count by what hangs on them") {
  std::atomic<double> calls = 0, pool = 0, other = 0;
  using Needs = Watchdog::Needs;
  WatchedLoop watched({{"calls", Needs::kReadiness, [&] { return calls.load(); }},
                       {"pool", Needs::kLiveness, [&] { return pool.load(); }},
                       {"log", Needs::kNothing, [&] { return other.load(); }}});
  other = 100;
  pool = 0.5;
  await([&] { return watched.looks > 3; });
  CHECK(watched.told().empty());
  CHECK(watched.is_live);
  pool = 100;
  await([&] { return !watched.is_live; });
  CHECK(watched.told().empty());
  calls = 0.5;
  await([&] { return watched.told().ends_with(": calls"); });
}

TEST_CASE("work pool: it stands still while what waits is not begun") {
  WorkPool pool(1, 16);
  CHECK(pool.still_seconds() == 0);
  std::atomic<bool> is_held = true;
  REQUIRE(pool.post(1, [&] {
    while (is_held) std::this_thread::sleep_for(milliseconds(1));
  }));
  await([&] { return pool.still_seconds() == 0; });
  REQUIRE(pool.post(1, [] {}));
  await([&] { return pool.still_seconds() > 0.05; });
  is_held = false;
  await([&] { return pool.still_seconds() == 0; });
}

TEST_CASE("call watch: the end of a call waits for the look that is under way, and none follows") {
  struct Call final : Monitored {
    std::atomic<bool> is_looking = false, is_held = true, has_ended = false;
    std::atomic<int> looks = 0;
    void on_tick(EventLoop::Clock::time_point) override {
      ++looks;
      is_looking = true;
      while (is_held) std::this_thread::sleep_for(milliseconds(1));
      is_looking = false;
    }
    void end() {
      end_ticks();
      has_ended = true;
    }
  } call;
  std::thread looking([&] { call.run_tick({}); });
  await([&] { return call.is_looking.load(); });
  std::thread ending([&] { call.end(); });
  std::this_thread::sleep_for(milliseconds(20));
  CHECK_FALSE(call.has_ended);
  call.is_held = false;
  await([&] { return call.has_ended.load(); });
  looking.join();
  ending.join();
  call.run_tick({});
  CHECK(call.looks == 1);
}

TEST_CASE("call watch: a call may end within its look") {
  struct Call final : Monitored {
    int looks = 0;
    void on_tick(EventLoop::Clock::time_point) override {
      ++looks;
      end_ticks();
    }
  } call;
  call.run_tick({});
  call.run_tick({});
  CHECK(call.looks == 1);
}

TEST_CASE("busy times: the longest counts") {
  BusyTimes times;
  CHECK(times.longest_seconds() == 0);
  {
    const BusyTimes::Scope first(times);
    std::this_thread::sleep_for(milliseconds(20));
    const BusyTimes::Scope second(times);
    CHECK(times.longest_seconds() >= 0.02);
  }
  CHECK(times.longest_seconds() == 0);
}
