#include "server/decode/zygote_process.h"

#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>

namespace heliograph::server {
namespace {

constexpr int kControl = 3;  // the zygote's end

/// Everything but the control socket and the standard descriptors is closed, whatever the daemon
/// has open; the signal mask and handlers are the defaults.
class SpawnSettings {
 public:
  explicit SpawnSettings(int control) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_adddup2(&actions_, control, kControl);
    posix_spawn_file_actions_addclosefrom_np(&actions_, kControl + 1);
    posix_spawnattr_init(&attributes_);
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes_, &none);
    posix_spawnattr_setsigdefault(&attributes_, &all);
    // A group of its own: Ctrl-C reaches the daemon, which drains, and not its decoders.
    posix_spawnattr_setpgroup(&attributes_, 0);
    posix_spawnattr_setflags(
        &attributes_, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  }
  SpawnSettings(const SpawnSettings&) = delete;
  ~SpawnSettings() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }
  posix_spawn_file_actions_t actions_;
  posix_spawnattr_t attributes_;
};

}  // namespace

Expected<std::unique_ptr<ZygoteProcess>> ZygoteProcess::start(const DecoderOptions& options) {
  auto sockets = socket_pair();
  if (!sockets) return std::unexpected(std::move(sockets).error());
  const std::array<std::string, 4> arguments = {
      options.program, std::to_string(options.memory_bytes), std::to_string(options.cpu_seconds),
      std::to_string(options.limits.bytes + (64ull << 20))};  // arrays and their message
  std::array<char*, 5> argv{};
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    argv[i] = const_cast<char*>(arguments[i].c_str());
  }
  char locale[] = "LC_ALL=C";
  char* const environment[] = {locale, nullptr};
  // dup2 onto itself would leave the descriptor closed on exec.
  Fd theirs = std::move(sockets->second);
  if (theirs.get() == kControl) theirs = Fd(dup(theirs.get()));
  const SpawnSettings settings(theirs.get());
  pid_t process = 0;
  const int code = posix_spawn(&process, options.program.c_str(), &settings.actions_,
                               &settings.attributes_, argv.data(), environment);
  if (code != 0) {
    errno = code;
    return fail(Code::kUnavailable, "", system_message(options.program.c_str()));
  }
  return std::unique_ptr<ZygoteProcess>(new ZygoteProcess(process, std::move(sockets->first)));
}

ZygoteProcess::~ZygoteProcess() {
  kill(process_, SIGKILL);  // its children die with it
  int status = 0;
  while (waitpid(process_, &status, 0) < 0 && errno == EINTR) {
  }
}

Status ZygoteProcess::launch(int job_socket, int job_region, int result_region) const {
  const int fds[] = {job_socket, job_region, result_region};
  return send_packet(control_.get(), PacketKind::kLaunch, "", fds);
}

decode::Hello ZygoteProcess::hello(double seconds) const {
  const std::lock_guard lock(mutex_);
  if (hello_) return *hello_;
  pollfd event{control_.get(), POLLIN, 0};
  decode::Hello hello;
  if (poll(&event, 1, int(seconds * 1000)) == 1) {
    auto packet = receive_packet(control_.get());
    if (packet && *packet && hello.ParseFromString((*packet)->bytes)) return *(hello_ = hello);
  }
  hello.add_refused("heliograph-decode does not answer");
  return hello;
}

}  // namespace heliograph::server
