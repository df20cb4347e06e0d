// The sandbox from inside: a forked child enters it and tries what an exploit would try.
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sched.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "server/decode/sandbox.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
using Catch::Matchers::Contains;

namespace {

/// Runs `attempt` in a child inside the sandbox; its exit status, or 128 + the signal that ended
/// it.
int confined(const std::function<int()>& attempt, const SandboxLimits& limits = {}) {
  const auto sandbox = Sandbox::prepare(limits);
  REQUIRE(sandbox);
  const pid_t child = fork();
  if (child == 0) {
    (void)sandbox->enter();
    _exit(attempt());
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

/// 0 when the call failed, as it should.
int failed(bool success) { return success ? 1 : 0; }

}  // namespace

TEST_CASE("sandbox: the layers that this kernel has are in force") {
  const auto sandbox = Sandbox::prepare({});
  REQUIRE(sandbox);
  int ends[2];
  REQUIRE(pipe(ends) == 0);
  const pid_t child = fork();
  if (child == 0) {
    const SandboxReport report = sandbox->enter();
    std::string text;
    for (const std::string& layer : report.active) text += layer + ",";
    for (const std::string& layer : report.refused) text += "!" + layer + ",";
    _exit(write(ends[1], text.data(), text.size()) == ssize_t(text.size()) ? 0 : 1);
  }
  close(ends[1]);
  std::string text(4096, '\0');
  text.resize(std::size_t(std::max<ssize_t>(read(ends[0], text.data(), text.size()), 0)));
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);
  CHECK(status == 0);
  // No decode goes without these; the others depend on the kernel and are reported.
  for (const char* layer : {"seccomp", "rlimits", "capabilities", "no_new_privs"}) {
    INFO(layer);
    CHECK_THAT(std::string(",").append(text), Contains(std::string(",").append(layer).append(",")));
  }
  WARN(text);
}

TEST_CASE("sandbox: no file can be opened, there or not") {
  for (const char* path : {"/etc/passwd", "/no/such/file", "/proc/self/mem", "/dev/null", "."}) {
    CHECK(confined([&] { return failed(open(path, O_RDONLY) >= 0); }) == 0);
    CHECK(confined([&] { return open(path, O_RDONLY) < 0 && errno == ENOENT ? 0 : 1; }) == 0);
  }
  CHECK(confined([] { return failed(open("/tmp/x", O_CREAT | O_WRONLY, 0600) >= 0); }) == 0);
  struct stat info;
  CHECK(confined([&] { return failed(stat("/etc/passwd", &info) == 0); }) == 0);
  CHECK(confined([] { return failed(unlink("/tmp/x") == 0); }) == 0);
  CHECK(confined([] { return failed(mkdir("/tmp/y", 0700) == 0); }) == 0);
  CHECK(confined([] { return failed(chdir("/") == 0); }) == 0);
}

TEST_CASE("sandbox: no socket, no process, no program, no signal to others") {
  CHECK(confined([] { return failed(socket(AF_INET, SOCK_STREAM, 0) >= 0); }) == 0);
  CHECK(confined([] { return failed(socket(AF_UNIX, SOCK_STREAM, 0) >= 0); }) == 0);
  CHECK(confined([] { return failed(fork() >= 0); }) == 0);
  CHECK(confined([] {
          char* arguments[] = {nullptr};
          return failed(execve("/bin/true", arguments, arguments) == 0);
        }) == 0);
  const pid_t parent = getpid();
  CHECK(confined([&] { return failed(kill(parent, 0) == 0); }) == 0);
  CHECK(confined([&] { return failed(ptrace(PTRACE_ATTACH, parent, nullptr, nullptr) == 0); }) ==
        0);
}

TEST_CASE("sandbox: memory is never made executable") {
  CHECK(confined([] {
          void* at = mmap(nullptr, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
          return failed(at != MAP_FAILED);
        }) == 0);
  CHECK(confined([] {
          void* at =
              mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
          return at != MAP_FAILED && mprotect(at, 4096, PROT_READ | PROT_EXEC) != 0 ? 0 : 1;
        }) == 0);
}

TEST_CASE("sandbox: no capability is left, and none can be had") {
  // From outside: inside, no file can be opened.
  const auto sandbox = Sandbox::prepare({});
  REQUIRE(sandbox);
  int ends[2];
  REQUIRE(pipe(ends) == 0);
  const pid_t child = fork();
  if (child == 0) {
    (void)sandbox->enter();
    (void)!write(ends[1], "x", 1);
    while (true) sched_yield();
  }
  char ready = 0;
  REQUIRE(read(ends[0], &ready, 1) == 1);
  std::ifstream file("/proc/" + std::to_string(child) + "/status");
  std::map<std::string, std::string> status;
  for (std::string name, value; file >> name && std::getline(file >> std::ws, value);)
    status[name] = value;
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  for (const char* set : {"CapInh:", "CapPrm:", "CapEff:", "CapAmb:"}) {
    INFO(set);
    CHECK(status[set] == "0000000000000000");
  }
  CHECK(status["NoNewPrivs:"] == "1");
  CHECK(status["Seccomp:"] == "2");
}

TEST_CASE("sandbox: threads that were there go on, and no other starts") {
  const auto sandbox = Sandbox::prepare({});
  REQUIRE(sandbox);
  const pid_t child = fork();
  if (child == 0) {
    std::atomic<int> sum = 0;
    std::atomic<bool> is_closed = false;
    std::optional<std::thread> helper;
    (void)sandbox->enter([&] {
      helper.emplace([&] {
        while (!is_closed) std::this_thread::yield();
        const int opened = open("/etc/passwd", O_RDONLY);  // it is confined too
        sum += opened < 0 && errno == ENOENT ? 1 : 100;
      });
    });
    is_closed = true;
    helper->join();
    try {
      std::thread([] {}).join();
      sum += 1000;
    } catch (const std::system_error&) {
    }
    _exit(sum == 1 ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  CHECK(status == 0);
}

TEST_CASE("sandbox: what decoding needs goes on working") {
  CHECK(confined([] {
          std::vector<char> memory(64 << 20, 1);
          return memory.back() == 1 ? 0 : 1;
        }) == 0);
}

TEST_CASE("sandbox: a file is written when its parent allows it") {
  const int region = memfd_create("x", MFD_ALLOW_SEALING);
  REQUIRE(region >= 0);
  const auto grow = [&] {
    signal(SIGXFSZ, SIG_IGN);
    return failed(ftruncate(region, 100) == 0);
  };
  CHECK(confined(grow) != 1);
  const auto sandbox = Sandbox::prepare({.file_bytes = 1000});
  REQUIRE(sandbox);
  int ends[2], back[2];
  REQUIRE((pipe(ends) == 0 && pipe(back) == 0));
  const pid_t child = fork();
  if (child == 0) {
    (void)sandbox->enter();
    char go = 0;
    (void)!write(ends[1], &go, 1);
    (void)!read(back[0], &go, 1);
    _exit(ftruncate(region, 100) == 0 && pwrite(region, "x", 1, 0) == 1 ? 0 : 1);
  }
  char ready = 0;
  REQUIRE(read(ends[0], &ready, 1) == 1);
  rlimit limit{};
  REQUIRE(prlimit(child, RLIMIT_FSIZE, nullptr, &limit) == 0);
  CHECK(limit.rlim_cur == 0);
  CHECK(limit.rlim_max == 1000);
  limit.rlim_cur = 100;
  REQUIRE(prlimit(child, RLIMIT_FSIZE, &limit, nullptr) == 0);
  REQUIRE(write(back[1], &ready, 1) == 1);
  int status = 0;
  waitpid(child, &status, 0);
  CHECK(status == 0);
}

TEST_CASE("sandbox: memory and time end where they are limited") {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  const auto grab = [] {
    const std::size_t size = 512 << 20;
    return mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) ==
                   MAP_FAILED
               ? 0
               : 1;
  };
  CHECK(confined(grab, {.memory_bytes = 256 << 20}) == 0);
  CHECK(confined(grab, {.memory_bytes = 4ull << 30}) == 1);
#endif
  const auto spin = [] {
    volatile bool forever = true;
    while (forever) {
    }
    return 0;
  };
  CHECK(confined(spin, {.cpu_seconds = 1}) == 128 + SIGXCPU);
}
