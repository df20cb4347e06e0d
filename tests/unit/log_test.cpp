// What is logged: harmless on a terminal, and nobody waits for its reader.
#include "server/os/log.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <thread>

#include "server/os/unique_fd.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
using Clock = std::chrono::steady_clock;

namespace {

struct Pipe {
  UniqueFd reader, writer;
  Pipe() {
    std::array<int, 2> ends{};
    REQUIRE(::pipe2(ends.data(), O_CLOEXEC) == 0);
    reader = UniqueFd(ends[0]);
    writer = UniqueFd(ends[1]);
    ::fcntl(reader.get(), F_SETFL, O_NONBLOCK);
  }
  std::string read_until(std::string_view text) const {
    std::string all;
    for (int i = 0; i < 500 && all.find(text) == std::string::npos; ++i) {
      std::array<char, 65536> piece;
      const ssize_t size = ::read(reader.get(), piece.data(), piece.size());
      if (size > 0) all.append(piece.data(), std::size_t(size));
      if (size < 0) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return all;
  }
};

/// The sum of what its lines say was dropped.
u64 told_in(const std::string& text) {
  constexpr std::string_view kField = "lines=\"";
  u64 sum = 0;
  for (auto at = text.find(kField); at != std::string::npos; at = text.find(kField, at + 1))
    sum += std::strtoull(text.c_str() + at + kField.size(), nullptr, 10);
  return sum;
}

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

}  // namespace

TEST_CASE("log: controls, directions and what is no UTF-8 are escaped") {
  CHECK(quoted("a\"b\\c", 99) == R"("a\"b\\c")");
  CHECK(quoted("\n\x1b\x7f", 99) == R"("\u000a\u001b\u007f")");
  CHECK(quoted("\u009b31m \u202e \u2028 \u0085 \u2066 \ufeff \u200b", 99) ==
        R"("\u009b31m \u202e \u2028 \u0085 \u2066 \ufeff \u200b")");
  CHECK(quoted("\U000e0041", 99) == R"("\udb40\udc41")");
  CHECK(quoted("Käfig \U0001f600", 99) == "\"Käfig \U0001f600\"");
  CHECK(quoted("\x9b\xc3(\xed\xa0\x80\xc0\xaf\xe2\x82", 99) ==
        R"("\\x9b\\xc3(\\xed\\xa0\\x80\\xc0\\xaf\\xe2\\x82")");
}

TEST_CASE("log: long values are cut between characters") {
  CHECK(quoted("12345", 5) == "\"12345\"");
  CHECK(quoted("123456789", 5) == "\"12345... 4 bytes more\"");
  CHECK(quoted("1234\u00e4", 5) == "\"1234... 2 bytes more\"");
}

TEST_CASE("log: a reader that stops makes nobody wait, and is told what it missed") {
  const Pipe pipe;
  ::fcntl(pipe.writer.get(), F_SETPIPE_SZ, 4096);
  const Log log("info", false, {.bytes = 4096, .value_bytes = 100}, pipe.writer.get());
  const auto start = Clock::now();
  for (int i = 0; i < 10'000; ++i) log.info("event", {{"number", i}});
  CHECK(seconds_since(start) < 2);
  CHECK(log.dropped() > 1000);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  CHECK(log.still_seconds() > 0);
  const std::string first = pipe.read_until("\n");
  CHECK(first.find("number=\"0\"") != std::string::npos);
  std::string read = first;
  for (int i = 0; i < 50 && told_in(read) < log.dropped(); ++i) read += pipe.read_until("lines=");
  CHECK(told_in(read) == log.dropped());
  log.info("again");
  CHECK(pipe.read_until("again").find("again") != std::string::npos);
}

TEST_CASE("log: the end waits for a second, not for a reader") {
  std::signal(SIGPIPE, SIG_IGN);  // as main does: the writer is left behind with its line
  Pipe pipe;
  const int writer = pipe.writer.release();  // and with its end of the pipe
  const auto start = Clock::now();
  {
    const Log log("info", true, {.bytes = 1 << 20, .value_bytes = 100}, writer);
    for (int i = 0; i < 3000; ++i) log.info("event", {{"number", i}});
  }
  CHECK(seconds_since(start) < 3);
  CHECK(seconds_since(start) > 0.9);
}

TEST_CASE("log: what waits is written at the end") {
  const Pipe pipe;
  {
    const Log log("debug", true, {}, pipe.writer.get());
    for (int i = 0; i < 100; ++i) log.debug("event", {{"number", i}});
  }
  CHECK(pipe.read_until("\"99\"").find(R"("event":"event","number":"99"})") != std::string::npos);
}
