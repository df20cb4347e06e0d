#include "server/session/request_log.h"

#include <atomic>
#include <mutex>
#include <thread>

#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

Expected<v1::ApplyReply> reply(u64 revision) {
  v1::ApplyReply made;
  made.set_revision(revision);
  return made;
}

/// An edit that is done at once.
template <class Apply>
EditLog::Reply reply_of(EditLog& log, u64 number, const Apply& apply) {
  EditLog::Reply got;
  log.answer(
      number, [&](const EditLog::Finish& finish) { finish({apply()}); },
      [&](const EditLog::Reply& reply) { got = reply; });
  REQUIRE(got);
  return got;
}

std::shared_ptr<EditLog> make_log(WorkPool& pool, ReplyLimits limits = {}) {
  return std::make_shared<EditLog>(std::make_shared<Strand>(pool, 1, 4), limits, Charge());
}

}  // namespace

TEST_CASE("edit log: the next number runs once, an old one is answered again") {
  WorkPool pool(1, 4);
  const auto log = make_log(pool);
  int runs = 0;
  const auto apply = [&] { return reply(u64(++runs)); };
  CHECK(log->next() == 1);
  CHECK((*reply_of(*log, 1, apply))->revision() == 1);
  CHECK((*reply_of(*log, 2, apply))->revision() == 2);
  CHECK((*reply_of(*log, 1, apply))->revision() == 1);
  CHECK(runs == 2);
  CHECK(log->next() == 3);
}

TEST_CASE("edit log: a refusal is kept too, and uses its number up") {
  WorkPool pool(1, 4);
  const auto log = make_log(pool);
  int runs = 0;
  const auto refuse = [&]() -> Expected<v1::ApplyReply> {
    ++runs;
    return fail(Code::kNotFound, "edits[0]", "no");
  };
  CHECK(reply_of(*log, 1, refuse)->error().code == Code::kNotFound);
  CHECK(reply_of(*log, 1, refuse)->error().code == Code::kNotFound);
  CHECK(runs == 1);
  CHECK(log->next() == 2);
}

TEST_CASE("edit log: a gap and a forgotten number name the number expected") {
  WorkPool pool(1, 4);
  const auto log = make_log(pool, {.replies = 3, .bytes = 1 << 20});
  for (u64 i = 1; i <= 5; ++i) REQUIRE(*reply_of(*log, i, [&] { return reply(i); }));
  for (const u64 number : {1ull, 2ull, 7ull}) {
    const auto answer = reply_of(*log, number, [&] { return reply(0); });
    REQUIRE(!*answer);
    CHECK(answer->error().code == Code::kAborted);
    CHECK(answer->error().expected == 6);
  }
  CHECK((*reply_of(*log, 3, [&] { return reply(0); }))->revision() == 3);
  const auto none = reply_of(*log, 0, [&] { return reply(0); });
  REQUIRE(!*none);
  CHECK(none->error().code == Code::kInvalidArgument);
  CHECK(none->error().where == "number");
}

TEST_CASE("edit log: kept replies are bounded by bytes") {
  WorkPool pool(1, 4);
  const auto log = make_log(pool, {.replies = 1000, .bytes = 10'000});
  const auto large = [] {
    v1::ApplyReply made;
    made.set_ids(std::string(4000, 'x'));
    return Expected<v1::ApplyReply>(made);
  };
  for (u64 i = 1; i <= 9; ++i) REQUIRE(*reply_of(*log, i, large));
  CHECK(*reply_of(*log, 9, large));
  CHECK(*reply_of(*log, 8, large));
  CHECK(!*reply_of(*log, 7, large));
}

TEST_CASE("edit log: edits that end later are answered once, in any order of asking") {
  WorkPool pool(1, 4);
  const auto log = make_log(pool);
  std::vector<EditLog::Finish> running;
  std::vector<u64> told;
  const auto apply = [&](EditLog::Finish finish) { running.push_back(std::move(finish)); };
  const auto done = [&](const EditLog::Reply& got) {
    told.push_back(*got ? (*got)->revision() : 0);
  };
  for (const u64 number : {1, 2, 1}) log->answer(number, apply, done);
  REQUIRE(running.size() == 2);
  CHECK(told.empty());
  CHECK(log->next() == 3);
  CHECK(log->state().last == 0);
  running[0]({reply(7)});
  CHECK(told == std::vector<u64>{7, 7});
  CHECK(log->state().last == 1);
  running[1]({reply(8)});
  CHECK(told == std::vector<u64>{7, 7, 8});
  CHECK(log->state().kept.size() == 2);
}

TEST_CASE("edit log: what was not kept frees its number, and those after it") {
  WorkPool pool(1, 4);
  const auto log = make_log(pool);
  std::vector<EditLog::Finish> running;
  std::vector<Code> told;
  const auto apply = [&](EditLog::Finish finish) { running.push_back(std::move(finish)); };
  const auto done = [&](const EditLog::Reply& got) {
    told.push_back(*got ? Code() : got->error().code);
  };
  const auto lost = []() -> Expected<v1::ApplyReply> {
    Error error{.code = Code::kUnavailable, .message = "disk", .where = ""};
    error.retry_seconds = 1;
    return std::unexpected(std::move(error));
  };
  reply_of(*log, 1, [] { return reply(1); });
  log->answer(2, apply, done);
  log->answer(3, apply, done);
  running[0](lost());
  CHECK(log->next() == 2);
  running[1](lost());
  CHECK(told == std::vector<Code>{Code::kUnavailable, Code::kUnavailable});
  CHECK(log->next() == 2);
  CHECK((*reply_of(*log, 1, [] { return reply(0); }))->revision() == 1);
  CHECK((*reply_of(*log, 2, [] { return reply(5); }))->revision() == 5);
}

TEST_CASE("edit log: restored, it goes on where it was") {
  WorkPool pool(1, 4);
  const auto log = make_log(pool), next = make_log(pool);
  for (u64 i = 1; i <= 5; ++i) reply_of(*log, i, [&] { return reply(10 + i); });
  next->restore(log->state());
  CHECK(next->next() == 6);
  CHECK((*reply_of(*next, 4, [] { return reply(0); }))->revision() == 14);
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
  const auto strand = std::make_shared<Strand>(pool, 1, 1000);
  std::vector<int> order;
  for (int i = 0; i < 500; ++i)
    REQUIRE(strand->run([&order, i] { order.push_back(i); }, i % 3 == 0));
  pool.stop();
  REQUIRE(order.size() == 500);
  CHECK(std::ranges::is_sorted(order));
}

namespace {

/// A pool whose one thread is busy until release().
struct BusyPool {
  explicit BusyPool(u32 capacity) : pool(1, capacity) {
    gate.lock();
    REQUIRE(pool.post(WorkPool::kDaemon, [this] {
      is_running = true;
      const std::lock_guard wait(gate);
    }));
    while (!is_running) std::this_thread::yield();
  }
  void release() {
    gate.unlock();
    pool.stop();
  }
  std::mutex gate;
  std::atomic<bool> is_running = false;
  WorkPool pool;
};

}  // namespace

TEST_CASE("work pool: a tenant fills half of the queue, and others find room") {
  BusyPool busy(16);
  for (int i = 0; i < 8; ++i) CHECK(busy.pool.post(1, [] {}));
  CHECK(busy.pool.post(1, [] {}).error().code == Code::kResourceExhausted);
  for (int i = 0; i < 4; ++i) CHECK(busy.pool.post(2, [] {}));
  CHECK_FALSE(busy.pool.post(2, [] {}));
  CHECK(busy.pool.post(3, [] {}));
  busy.release();
}

TEST_CASE("work pool: tenants take turns, and so do strands") {
  BusyPool busy(1000);
  std::string order;
  for (int i = 0; i < 4; ++i) REQUIRE(busy.pool.post(1, [&] { order += 'a'; }));
  for (int i = 0; i < 2; ++i) REQUIRE(busy.pool.post(2, [&] { order += 'b'; }));
  const auto strand = std::make_shared<Strand>(busy.pool, 3, 100);
  for (int i = 0; i < 40; ++i) REQUIRE(strand->run([&] { order += 's'; }, false));
  busy.release();
  const std::string turn(16, 's');
  CHECK(order == "ab" + turn + "ab" + turn + "a" + std::string(8, 's') + "a");
}
