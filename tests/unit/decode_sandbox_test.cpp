// The sandbox from inside: a forked child enters it and tries what an exploit would try.
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <functional>
#include <thread>
#include <vector>

#include "server/decode/sandbox.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

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
  // Without these two nothing confines a child; the others depend on the kernel and are reported.
  CHECK(text.find("seccomp,") != text.npos);
  CHECK(text.find("!seccomp") == text.npos);
  CHECK(text.find("no_new_privs,") != text.npos);
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

TEST_CASE("sandbox: what decoding needs goes on working") {
  CHECK(confined([] {
          int sum = 0;
          std::thread([&] { sum += 1; }).join();
          std::vector<char> memory(64 << 20, 1);
          return sum == 1 && memory.back() == 1 ? 0 : 1;
        }) == 0);
  CHECK(confined([] {
          const int fd = memfd_create("x", MFD_ALLOW_SEALING);
          return fd >= 0 && ftruncate(fd, 100) == 0 && pwrite(fd, "x", 1, 0) == 1 &&
                         fcntl(fd, F_ADD_SEALS, F_SEAL_WRITE) == 0
                     ? 0
                     : 1;
        }) == 0);
}

TEST_CASE("sandbox: memory, time and file size end where they are limited") {
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
  const auto write_much = [] {
    signal(SIGXFSZ, SIG_IGN);
    const int fd = memfd_create("x", 0);
    return failed(ftruncate(fd, 2 << 20) == 0);
  };
  CHECK(confined(write_much, {.file_bytes = 1 << 20}) != 1);
}
