#include "server/request_log.h"

#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

Expected<v1::ApplyReply> reply(u64 revision) {
  v1::ApplyReply made;
  made.set_revision(revision);
  return made;
}

}  // namespace

TEST_CASE("edit log: the next number runs once, an old one is answered again") {
  WorkPool pool(1, 4);
  EditLog log(pool, {}, 4);
  int runs = 0;
  const auto apply = [&] { return reply(u64(++runs)); };
  CHECK(log.next() == 1);
  CHECK((*log.answer(1, apply))->revision() == 1);
  CHECK((*log.answer(2, apply))->revision() == 2);
  CHECK((*log.answer(1, apply))->revision() == 1);
  CHECK(runs == 2);
  CHECK(log.next() == 3);
}

TEST_CASE("edit log: a refusal is kept too, and uses its number up") {
  WorkPool pool(1, 4);
  EditLog log(pool, {}, 4);
  int runs = 0;
  const auto refuse = [&]() -> Expected<v1::ApplyReply> {
    ++runs;
    return fail(Code::kNotFound, "edits[0]", "no");
  };
  CHECK(log.answer(1, refuse)->error().code == Code::kNotFound);
  CHECK(log.answer(1, refuse)->error().code == Code::kNotFound);
  CHECK(runs == 1);
  CHECK(log.next() == 2);
}

TEST_CASE("edit log: a gap and a forgotten number name the number expected") {
  WorkPool pool(1, 4);
  EditLog log(pool, {.replies = 3, .bytes = 1 << 20}, 4);
  for (u64 i = 1; i <= 5; ++i) REQUIRE(*log.answer(i, [&] { return reply(i); }));
  for (const u64 number : {0ull, 1ull, 2ull, 7ull}) {
    const auto answer = log.answer(number, [&] { return reply(0); });
    REQUIRE(!*answer);
    CHECK(answer->error().code == Code::kAborted);
    CHECK(answer->error().expected == 6);
  }
  CHECK((*log.answer(3, [&] { return reply(0); }))->revision() == 3);
}

TEST_CASE("edit log: kept replies are bounded by bytes") {
  WorkPool pool(1, 4);
  EditLog log(pool, {.replies = 1000, .bytes = 10'000}, 4);
  const auto large = [] {
    v1::ApplyReply made;
    made.set_ids(std::string(4000, 'x'));
    return Expected<v1::ApplyReply>(made);
  };
  for (u64 i = 1; i <= 9; ++i) REQUIRE(*log.answer(i, large));
  CHECK(*log.answer(9, large));
  CHECK(*log.answer(8, large));
  CHECK(!*log.answer(7, large));
}

TEST_CASE("request log: done once, failures not kept, oldest forgotten") {
  RequestLog log({.replies = 2, .bytes = 1 << 20});
  CHECK(!*log.begin("a", "Create"));
  CHECK(log.begin("a", "Create").error().code == Code::kAborted);
  log.finish("a", "reply");
  CHECK(*log.begin("a", "Create") == "reply");
  CHECK(log.begin("a", "Delete").error().code == Code::kInvalidArgument);
  CHECK(!*log.begin("b", "Create"));
  log.finish("b", std::nullopt);
  CHECK(!*log.begin("b", "Create"));
  log.finish("b", "b");
  CHECK(!*log.begin("c", "Create"));
  log.finish("c", "c");
  CHECK(!*log.begin("a", "Create"));
}

TEST_CASE("strand: tasks run in order, one at a time") {
  WorkPool pool(4, 4);
  const auto strand = std::make_shared<Strand>(pool, 1000);
  std::vector<int> order;
  for (int i = 0; i < 500; ++i)
    REQUIRE(strand->run([&order, i] { order.push_back(i); }, i % 3 == 0));
  pool.stop();
  REQUIRE(order.size() == 500);
  CHECK(std::ranges::is_sorted(order));
}

TEST_CASE("work pool: what does not fit is refused") {
  WorkPool pool(1, 2);
  std::mutex gate;
  gate.lock();
  std::atomic<bool> is_running = false;
  REQUIRE(pool.post([&] {
    is_running = true;
    const std::lock_guard wait(gate);
  }));
  while (!is_running) std::this_thread::yield();
  CHECK(pool.post([] {}));
  CHECK(pool.post([] {}));
  CHECK(pool.post([] {}).error().code == Code::kResourceExhausted);
  gate.unlock();
}
