#include "server/decode/child_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace heliograph::server {
namespace {

/// Duplicates a descriptor to a number above those of the child.
Fd above(const Fd& fd) { return Fd(fcntl(fd.get(), F_DUPFD_CLOEXEC, kResultRegion + 1)); }

/// Spawn attributes: closes all descriptors but the standard ones and the child's own; default
/// signal mask and handlers.
class SpawnSettings {
 public:
  SpawnSettings(int socket, int job, int result) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_adddup2(&actions_, socket, kSocket);
    posix_spawn_file_actions_adddup2(&actions_, job, kJobRegion);
    posix_spawn_file_actions_adddup2(&actions_, result, kResultRegion);
    posix_spawn_file_actions_addclosefrom_np(&actions_, kResultRegion + 1);
    posix_spawnattr_init(&attributes_);
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes_, &none);
    posix_spawnattr_setsigdefault(&attributes_, &all);
    // A process group of its own: Ctrl-C reaches the daemon, which drains, and not its decoders.
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

Expected<pid_t> spawn(const DecoderOptions& options, const SpawnSettings& settings) {
  std::string without;
  for (const std::string& layer : options.without) without += layer + ",";
  const std::array<std::string, 5> arguments = {
      options.program, std::to_string(options.memory_bytes), std::to_string(options.cpu_seconds),
      std::to_string(options.limits.bytes + kMessageBytes), without};
  std::array<char*, 6> argv{};
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    argv[i] = const_cast<char*>(arguments[i].c_str());
  }
  char locale[] = "LC_ALL=C";
  // OpenImageIO fills 25 MB of tables as it loads: three times as fast in huge pages.
  char pages[] = "GLIBC_TUNABLES=glibc.malloc.hugetlb=1:glibc.malloc.top_pad=33554432";
  char threads[] = "OPENIMAGEIO_THREADS=1";  // that end_picture_threads() ends
  char* const environment[] = {locale, pages, threads, nullptr};
  pid_t process = 0;
  const int code = posix_spawn(&process, options.program.c_str(), &settings.actions_,
                               &settings.attributes_, argv.data(), environment);
  if (code == 0) return process;
  errno = code;
  return fail(Code::kUnavailable, "", system_message(options.program.c_str()));
}

}  // namespace

Expected<std::unique_ptr<ChildProcess>> ChildProcess::start(const DecoderOptions& options) {
  auto sockets = socket_pair();
  if (!sockets) return std::unexpected(std::move(sockets).error());
  auto job = make_region();
  if (!job) return std::unexpected(std::move(job).error());
  auto result = make_region();
  if (!result) return std::unexpected(std::move(result).error());
  const Fd theirs = above(sockets->second), their_job = above(*job), their_result = above(*result);
  if (!theirs || !their_job || !their_result)
    return fail(Code::kResourceExhausted, "", system_message("fcntl"));
  const auto process =
      spawn(options, SpawnSettings(theirs.get(), their_job.get(), their_result.get()));
  if (!process) return std::unexpected(process.error());
  return std::unique_ptr<ChildProcess>(
      new ChildProcess(*process, std::move(sockets->first), std::move(*job), std::move(*result)));
}

bool ChildProcess::has_ended() const {
  pollfd event{socket_.get(), POLLIN, 0};
  return poll(&event, 1, 0) != 0;
}

ChildProcess::~ChildProcess() { (void)reap(); }

int ChildProcess::reap() {
  int status = 0;
  if (process_ == 0) return status;
  kill(process_, SIGKILL);  // no effect on one that ended
  while (waitpid(process_, &status, 0) < 0 && errno == EINTR) {
  }
  process_ = 0;
  return status;
}

Status ChildProcess::begin(const google::protobuf::MessageLite& job, std::span<const Bytes> files) {
  HELIO_TRY(fill_region(job_.get(), job, files));
  HELIO_TRY(seal_region(job_.get()));
  return send_packet(socket_.get(), PacketKind::kGo);
}

Status ChildProcess::grant(u64 bytes) {
  rlimit limit{};
  if (prlimit(process_, RLIMIT_FSIZE, nullptr, &limit) != 0)
    return fail(Code::kInternal, "", system_message("prlimit"));
  if (bytes > limit.rlim_max) {
    Error error{.code = Code::kResourceExhausted,
                .message = fmt::format("decodes to {} bytes, {} are allowed "
                                       "(limit decode_result_bytes)",
                                       bytes, limit.rlim_max),
                .where = ""};
    error.limit = "decode_result_bytes";
    error.needed = bytes;
    error.available = limit.rlim_max;
    return std::unexpected(std::move(error));
  }
  limit.rlim_cur = bytes;
  if (prlimit(process_, RLIMIT_FSIZE, &limit, nullptr) != 0)
    return fail(Code::kInternal, "", system_message("prlimit"));
  granted_ = bytes;
  return send_packet(socket_.get(), PacketKind::kGrant);
}

Expected<std::shared_ptr<const Region>> ChildProcess::result() const {
  HELIO_TRY(seal_region(result_.get()));
  return Region::map(result_.get(), granted_);
}

std::string ChildProcess::how_it_ended() {
  const int status = reap();
  if (WIFEXITED(status)) return fmt::format("exited with {}", WEXITSTATUS(status));
  const char* name = sigabbrev_np(WTERMSIG(status));
  return fmt::format("was killed by SIG{}", name ? name : std::to_string(WTERMSIG(status)));
}

}  // namespace heliograph::server
