// Whose decode is next.
#include "server/decode/queue.h"

#include <future>
#include <thread>

#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

void push(DecodeQueue& queue, u64 tenant, int count = 1) {
  for (int i = 0; i < count; ++i) {
    DecodeTask task;
    task.job.tenant = tenant;
    REQUIRE(queue.push(task));
  }
}
u64 take(DecodeQueue& queue) { return queue.take({})->job.tenant; }

}  // namespace

TEST_CASE("decode queue: tenants take turns, whoever has more that waits") {
  DecodeQueue queue({.running = 100, .waiting = 100});
  push(queue, 1, 60);
  CHECK(take(queue) == 1);
  push(queue, 2, 2);
  push(queue, 3);
  CHECK(take(queue) == 2);
  CHECK(take(queue) == 3);
  CHECK(take(queue) == 1);
  CHECK(take(queue) == 2);
  CHECK(take(queue) == 1);
}

TEST_CASE("decode queue: a tenant has its processes and no more until one ends") {
  DecodeQueue queue({.running = 2, .waiting = 100});
  push(queue, 1, 5);
  CHECK(take(queue) == 1);
  CHECK(take(queue) == 1);
  push(queue, 2);
  CHECK(take(queue) == 2);
  auto third = std::async(std::launch::async, [&] { return take(queue); });
  CHECK(third.wait_for(std::chrono::milliseconds(50)) == std::future_status::timeout);
  queue.end(2);
  CHECK(third.wait_for(std::chrono::milliseconds(50)) == std::future_status::timeout);
  queue.end(1);
  CHECK(third.get() == 1);
}

TEST_CASE("decode queue: too many that wait are refused, of their tenant alone") {
  DecodeQueue queue({.running = 1, .waiting = 3});
  push(queue, 1, 3);
  DecodeTask more;
  more.job.tenant = 1;
  const Status refused = queue.push(more);
  REQUIRE_FALSE(refused);
  CHECK(refused.error().code == Code::kResourceExhausted);
  CHECK(refused.error().retry_seconds > 0);
  CHECK_THAT(refused.error().message, Catch::Matchers::Contains("decode_queue"));
  push(queue, 2);
  CHECK(queue.rest().size() == 4);
}

TEST_CASE("decode queue: who waits for a task ends when it is told") {
  DecodeQueue queue({});
  std::jthread waiting([&](const std::stop_token& stop) { CHECK_FALSE(queue.take(stop)); });
  waiting.request_stop();
}
