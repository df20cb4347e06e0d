// heliograph-decode: the zygote. It loads the libraries once, forks a sandboxed child for each job,
// and says how each child ended. Started by the daemon with its control socket as descriptor 3.
#include <fcntl.h>
#include <malloc.h>
#include <poll.h>
#include <sys/signalfd.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <charconv>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <map>

#include "renderer/assets/load.h"
#include "server/decode/child.h"
#include "server/decode/sandbox.h"

namespace heliograph::server {
namespace {

constexpr int kControl = 3;
constexpr int kJobSocket = 4;
constexpr int kResultRegion = 5;

/// Keeps descriptors 0 to 2 as /dev/null and closes all others but these two.
void keep_only(int socket, int result) {
  const int moved_socket = fcntl(socket, F_DUPFD, kResultRegion + 1);  // either may be 4 or 5 now
  const int moved_result = fcntl(result, F_DUPFD, kResultRegion + 1);
  dup2(moved_socket, kJobSocket);
  dup2(moved_result, kResultRegion);
  close(kControl);
  close_range(kResultRegion + 1, ~0u, 0);
}

/// Runs in a new child; does not return.
[[noreturn]] void decode_in_child(const Sandbox& sandbox, const Packet& launch) {
  const auto job = Region::map(launch.fds[1].get(), ~0ull);
  keep_only(launch.fds[0].get(), launch.fds[2].get());
  (void)sandbox.enter();
  if (job) run_job(**job, kJobSocket, kResultRegion);
  _exit(0);
}

/// What the sandbox has here is found out by entering it once.
[[noreturn]] void probe_in_child(const Sandbox& sandbox) {
  const SandboxReport report = sandbox.enter();
  decode::Hello hello;
  for (const std::string& layer : report.active) hello.add_sandbox(layer);
  for (const std::string& layer : report.refused) hello.add_refused(layer);
  hello.set_versions(decoder_versions());
  (void)send_packet(kControl, PacketKind::kHello, hello.SerializeAsString(), {});
  _exit(0);
}

class Zygote {
 public:
  explicit Zygote(const Sandbox& sandbox) : sandbox_(sandbox) {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGCHLD);
    sigprocmask(SIG_BLOCK, &signals, nullptr);
    signals_ = Fd(signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK));
  }

  /// Until the daemon closes the control socket.
  int run() {
    if (fork() == 0) probe_in_child(sandbox_);
    pollfd events[] = {{kControl, POLLIN, 0}, {signals_.get(), POLLIN, 0}};
    while (true) {
      if (poll(events, 2, -1) < 0) continue;
      if (events[1].revents) reap();
      if (!events[0].revents) continue;
      auto packet = receive_packet(kControl);
      if (!packet || !*packet) return 0;
      if ((*packet)->fds.size() == 3) launch(**packet);
    }
  }

 private:
  void launch(Packet& packet) {
    const pid_t child = fork();
    if (child == 0) decode_in_child(sandbox_, packet);
    const int job_socket = packet.fds[0].get();
    if (child < 0) {
      const int status = -1;
      (void)send_packet(job_socket, PacketKind::kExited,
                        {reinterpret_cast<const char*>(&status), sizeof status}, {});
      return;
    }
    const Fd process(int(syscall(SYS_pidfd_open, child, 0)));
    const int fds[] = {process.get()};
    (void)send_packet(job_socket, PacketKind::kStarted, "",
                      process ? std::span<const int>(fds) : std::span<const int>());
    running_.emplace(child, std::move(packet.fds[0]));
  }

  void reap() {
    signalfd_siginfo info;
    while (read(signals_.get(), &info, sizeof info) == sizeof info) {
    }
    int status = 0;
    for (pid_t child; (child = waitpid(-1, &status, WNOHANG)) > 0;) {
      const auto job = running_.find(child);
      if (job == running_.end()) continue;
      (void)send_packet(job->second.get(), PacketKind::kExited,
                        {reinterpret_cast<const char*>(&status), sizeof status}, {});
      running_.erase(job);
    }
  }

  const Sandbox& sandbox_;
  Fd signals_;
  std::map<pid_t, Fd> running_;  // the job socket of each child
};

u64 number(const char* text) {
  u64 value = 0;
  const char* end = text + std::strlen(text);
  const auto [at, error] = std::from_chars(text, end, value);
  return error == std::errc() && at == end ? value : 0;
}

int run(int count, char** arguments) {
  if (count != 4) {
    std::fputs("heliograph-decode is started by heliographd: MEMORY_BYTES CPU_SECONDS FILE_BYTES\n",
               stderr);
    return 64;
  }
  const SandboxLimits limits{.memory_bytes = number(arguments[1]),
                             .cpu_seconds = u32(number(arguments[2])),
                             .file_bytes = number(arguments[3])};
  const auto sandbox = Sandbox::prepare(limits);
  if (!sandbox) {
    std::fprintf(stderr, "heliograph-decode: %s\n", sandbox.error().message.c_str());
    return 70;
  }
  const Fd nothing(open("/dev/null", O_RDWR | O_CLOEXEC));
  for (int fd = 0; fd < 3; ++fd) dup2(nothing.get(), fd);
  mallopt(M_ARENA_MAX, 2);  // an arena for each thread would not fit the address space
  return Zygote(*sandbox).run();
}

}  // namespace
}  // namespace heliograph::server

int main(int count, char** arguments) { return heliograph::server::run(count, arguments); }
