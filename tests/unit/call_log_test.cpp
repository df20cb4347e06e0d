// The lines of calls: whose, how they ended, when they are slow and where the time went.
#include "server/observe/call_log.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <nlohmann/json.hpp>
#include <thread>

#include "server/os/unique_fd.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
using std::chrono::milliseconds;

namespace {

/// What a log of that level says once `write` is over, a JSON object a line.
template <class Write>
std::vector<nlohmann::json> said(const std::string& level, const Write& write) {
  std::array<int, 2> ends{};
  REQUIRE(::pipe2(ends.data(), O_CLOEXEC) == 0);
  const UniqueFd reader(ends[0]);
  UniqueFd writer(ends[1]);
  {
    const Log log(level, true, {}, writer.get());
    Metrics metrics;
    write(CallLog(log, metrics,
                  {.slow_seconds = 1, .slow_render_seconds = 10, .scene_name = [](u64, u64) {
                     return std::string("room");
                   }}));
  }
  writer = UniqueFd();
  std::string text;
  std::array<char, 4096> piece;
  for (ssize_t size; (size = ::read(reader.get(), piece.data(), piece.size())) > 0;)
    text.append(piece.data(), std::size_t(size));
  std::vector<nlohmann::json> lines;
  for (std::size_t at = 0, end; (end = text.find('\n', at)) != std::string::npos; at = end + 1)
    lines.push_back(nlohmann::json::parse(text.substr(at, end - at)));
  return lines;
}

/// A call that began so long ago.
CallFacts call_of(Pace pace, double seconds) {
  CallFacts facts{
      .method = "/heliograph.v1.Renderer/Render",
      .start = CallClock::now() - milliseconds(i64(1000 * seconds)),
      .request = "r1",
      .trace = parse_trace("00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01", ""),
      .peer = "unix:",
      .tenant = "robots",
      .client = "trainer",
      .session = 7,
      .scene = 5,
      .scene_name = "",
      .pace = pace,
      .received_bytes = 12,
      .sent_bytes = 34,
      .jobs = {}};
  return facts;
}

}  // namespace

TEST_CASE("call log: a line says whose call it is and how it ended") {
  const auto lines = said("info", [](const CallLog& log) {
    log.end(call_of(Pace::kRender, 0.01), {});  // debug
    log.end(call_of(Pace::kRender, 0.01), {.code = 8, .reason = "planes: too many"});
    log.end(call_of(Pace::kRender, 99), {.code = 13, .reason = "a bug", .is_hidden = true});
  });
  REQUIRE(lines.size() == 2);
  const auto& line = lines[0];
  CHECK(line["level"] == "info");
  CHECK(line["event"] == "call");
  CHECK(line["request"] == "r1");
  CHECK(line["trace_id"] == "4bf92f3577b34da6a3ce929d0e0e4736");
  CHECK(line["span_id"] == "00f067aa0ba902b7");
  CHECK(line["tenant"] == "robots");
  CHECK(line["client"] == "trainer");
  CHECK(line["peer"] == "unix:");
  CHECK(line["scene"] == "5");
  CHECK(line["scene_name"] == "room");
  CHECK(line["code"] == "RESOURCE_EXHAUSTED");
  CHECK(line["reason"] == "planes: too many");
  CHECK(std::stod(line["ms"].get<std::string>()) >= 10);
  CHECK(line["received_bytes"] == "12");
  CHECK(line["sent_bytes"] == "34");
  CHECK(!line.contains("device_ms"));
  CHECK(lines[1]["level"] == "error");
  CHECK(lines[1]["reason"] == "a bug");
}

TEST_CASE("call log: what is not known is left out") {
  const auto lines = said("debug", [](const CallLog& log) {
    CallFacts facts;
    facts.start = CallClock::now();
    facts.method = "/grpc.health.v1.Health/Check";
    log.end(facts, {});
  });
  REQUIRE(lines.size() == 1);
  for (const char* name : {"trace_id", "span_id", "tenant", "client", "scene", "reason"})
    CHECK(!lines[0].contains(name));
}

TEST_CASE("call log: each kind of call has its own limit, and one that its client paces none") {
  const auto lines = said("warning", [](const CallLog& log) {
    log.end(call_of(Pace::kShort, 2), {});
    log.end(call_of(Pace::kRender, 2), {});
    log.end(call_of(Pace::kClient, 99), {});
    log.end(call_of(Pace::kRender, 20), {.code = 1});
  });
  REQUIRE(lines.size() == 2);
  for (const auto& line : lines) CHECK(line["event"] == "slow call");
  CHECK(lines[0]["code"] == "OK");
  CHECK(lines[1]["code"] == "CANCELLED");
}

TEST_CASE("call log: a slow call says where its time went") {
  const auto lines = said("warning", [](const CallLog& log) {
    CallFacts facts = call_of(Pace::kRender, 20);
    facts.jobs = {.count = 1,
                  .first = facts.start + milliseconds(1000),
                  .last = facts.start + milliseconds(15'000),
                  .waited_seconds = 2,
                  .aside_seconds = 3,
                  .device_seconds = 4};
    log.end(facts, {});
  });
  REQUIRE(lines.size() == 1);
  const auto ms = [&](const char* name) { return std::stod(lines[0][name].get<std::string>()); };
  CHECK(ms("before_ms") == 1000);
  CHECK(ms("queued_ms") == 2000);
  CHECK(ms("derived_ms") == 3000);
  CHECK(ms("device_ms") == 4000);
  CHECK(ms("others_ms") == 5000);
  CHECK(ms("sending_ms") >= 5000);
}

TEST_CASE("call log: of a call that its client paces each slow job is told") {
  const auto lines = said("warning", [](const CallLog& log) {
    for (const Pace pace : {Pace::kClient, Pace::kRender}) {
      CallRecord record;
      record.note([&](CallFacts& facts) { facts = call_of(pace, 100); });
      for (const double seconds : {5.0, 50.0})
        log.end_job(record, seconds, {.seconds = 4, .waited_seconds = 1, .aside_seconds = 2});
    }
  });
  REQUIRE(lines.size() == 1);
  CHECK(lines[0]["event"] == "slow job");
  CHECK(lines[0]["ms"] == "50000.000");
  CHECK(lines[0]["others_ms"] == "43000.000");
}
