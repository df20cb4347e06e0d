// Loops over the cores.
#include "renderer/base/parallel.h"

#include <mutex>
#include <set>
#include <thread>

#include "tests/unit/catch.h"

using namespace heliograph;

TEST_CASE("parallel: loops of several arenas have the limit's threads and their callers'") {
  const ThreadLimit limit(2);
  std::mutex mutex;
  std::set<std::thread::id> seen;
  const auto loop = [&] {
    tbb::task_arena arena(4);
    run_in(arena, [&] {
      parallel_for(64u, [&](u32) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        const std::scoped_lock lock(mutex);
        seen.insert(std::this_thread::get_id());
      });
    });
  };
  std::jthread one(loop), two(loop), three(loop);
  one.join();
  two.join();
  three.join();
  CHECK(seen.size() >= 3);
  CHECK(seen.size() <= 4);
}
