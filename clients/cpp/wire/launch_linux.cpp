// A private daemon by posix_spawn, pidfd and pipes.
#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "wire/launch.h"

extern char** environ;

namespace heliograph::client::wire {
namespace {

constexpr std::size_t kLogLines = 20;
constexpr std::size_t kPathBytes = 107;                            // of a socket, at most
constexpr const char* kLongerSocket = "/heliograph.sock.fd.sock";  // of the two in the folder
constexpr const char* kPlainPath =
    "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-._~/";
constexpr int kOwnerFd = 3;  // of the child
constexpr int kReadyFd = 4;
constexpr int kFreeFd = 16;  // own descriptors that the child's must not overwrite

/// A descriptor at or above kFreeFd that closes itself.
class Fd {
 public:
  Fd() = default;
  explicit Fd(int fd) : fd_(::fcntl(fd, F_DUPFD_CLOEXEC, kFreeFd)) { ::close(fd); }
  Fd(Fd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Fd& operator=(Fd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Fd() { reset(); }
  [[nodiscard]] int get() const { return fd_; }
  void reset() {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  }

 private:
  int fd_ = -1;
};

std::pair<Fd, Fd> make_pipe() {
  std::array<int, 2> ends{-1, -1};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    throw ClientError(Code::kUnavailable, std::string("no pipe for a private daemon: ") +
                                              std::strerror(errno) + "; close some files");
  Fd read(ends[0]);
  return {std::move(read), Fd(ends[1])};
}

/// A new folder that only this user may enter, where the paths of sockets are short enough.
std::string make_folder() {
  std::vector<std::string> parents;
  for (const char* name : {"XDG_RUNTIME_DIR", "TMPDIR"}) {
    const char* value = std::getenv(name);
    if (value != nullptr && *value == '/') parents.emplace_back(value);
  }
  parents.push_back("/run/user/" + std::to_string(::getuid()));
  parents.insert(parents.end(), {"/tmp", "/var/tmp", "/dev/shm"});
  std::string refused;
  for (const std::string& parent : parents) {
    std::string path = parent + "/heliograph-XXXXXX";
    std::string why = "gRPC takes letters, digits and -._~/ in a socket's path, 107 bytes at most";
    if (path.size() + std::strlen(kLongerSocket) <= kPathBytes &&
        path.find_first_not_of(kPlainPath) == std::string::npos) {
      if (::mkdtemp(path.data()) != nullptr) return path;
      why = std::strerror(errno);
    }
    refused += (refused.empty() ? "" : "; ") + parent + ": " + why;
  }
  throw ClientError(Code::kUnavailable,
                    "no folder for the sockets of a private daemon; set TMPDIR to one with a short "
                    "path where this user may write (" +
                        refused + ")");
}

std::string program_of(const LaunchOptions& options) {
  if (!options.program.empty()) return options.program;
  const char* named = std::getenv("HELIOGRAPHD");
  return named != nullptr && *named != '\0' ? named : "heliographd";
}

std::string describe(int code) {
  if (code >= 0) return "exit code " + std::to_string(code);
  return std::string("killed by ") + ::strsignal(-code);
}

/// The value of "socket" in the line of JSON that a daemon which listens writes.
std::string socket_of(const std::string& line) {
  const std::string key = "\"socket\":";
  std::size_t at = line.find(key);
  if (at == std::string::npos) return {};
  at = line.find('"', at + key.size());
  const std::size_t end = line.find('"', at + 1);
  return end == std::string::npos ? std::string() : line.substr(at + 1, end - at - 1);
}

}  // namespace

struct PrivateDaemon::Process {
  pid_t pid = -1;
  std::string program;
  std::string folder;
  std::string address;
  Fd log_end;
  std::thread reader;
  std::function<void(const std::string&)> log;
  std::mutex mutex;  // of what follows
  std::deque<std::string> lines;
  std::optional<int> exit_code;

  void spawn(const LaunchOptions& options, int owner, int ready, int output);
  void read_log();
  std::string read_ready(int fd, double seconds);
  /// Waits for its end, at most so long.
  bool reap(double seconds);
};

void PrivateDaemon::Process::spawn(const LaunchOptions& options, int owner, int ready, int output) {
  std::vector<std::string> words = {program,         "--private", "--socket-dir", folder,
                                    "--owner-pidfd", "3",         "--ready-fd",   "4"};
  words.insert(words.end(), options.arguments.begin(), options.arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);

  posix_spawn_file_actions_t files;
  ::posix_spawn_file_actions_init(&files);
  ::posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  const std::array<std::pair<int, int>, 4> kept{
      {{output, STDOUT_FILENO}, {output, STDERR_FILENO}, {owner, kOwnerFd}, {ready, kReadyFd}}};
  for (const auto& [from, to] : kept) ::posix_spawn_file_actions_adddup2(&files, from, to);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID);  // Ctrl-C is for this process
  const int failed =
      ::posix_spawnp(&pid, program.c_str(), &files, &attributes, argv.data(), environ);
  ::posix_spawnattr_destroy(&attributes);
  ::posix_spawn_file_actions_destroy(&files);
  if (failed != 0) {
    pid = -1;
    throw ClientError(Code::kUnavailable,
                      "cannot start " + program + ": " + std::strerror(failed) +
                          "; put heliographd on PATH, or set HELIOGRAPHD to its path");
  }
}

void PrivateDaemon::Process::read_log() {
  std::string line;
  std::array<char, 4096> buffer;
  for (ssize_t size = 0; (size = ::read(log_end.get(), buffer.data(), buffer.size())) > 0;) {
    for (const char c : std::string_view(buffer.data(), std::size_t(size))) {
      if (c != '\n') {
        line += c;
        continue;
      }
      if (log) log(line);
      const std::lock_guard lock(mutex);
      lines.push_back(std::exchange(line, {}));
      if (lines.size() > kLogLines) lines.pop_front();
    }
  }
}

std::string PrivateDaemon::Process::read_ready(int fd, double seconds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  std::string text;
  std::array<char, 4096> buffer;
  while (text.empty() || text.back() != '\n') {
    const auto left = end - std::chrono::steady_clock::now();
    pollfd waiting{fd, POLLIN, 0};
    const auto milliseconds = std::chrono::duration_cast<std::chrono::milliseconds>(left).count();
    if (milliseconds <= 0 || ::poll(&waiting, 1, int(milliseconds)) == 0) break;
    const ssize_t size = ::read(fd, buffer.data(), buffer.size());
    if (size <= 0) break;
    text.append(buffer.data(), std::size_t(size));
  }
  return text;
}

bool PrivateDaemon::Process::reap(double seconds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  for (;;) {
    {
      const std::lock_guard lock(mutex);
      int status = 0;
      if (exit_code) return true;
      if (::waitpid(pid, &status, WNOHANG) == pid) {
        exit_code = WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
        return true;
      }
    }
    if (std::chrono::steady_clock::now() >= end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

PrivateDaemon::PrivateDaemon(const LaunchOptions& options) : process_(std::make_unique<Process>()) {
  const auto end =
      std::chrono::steady_clock::now() + std::chrono::duration<double>(options.timeout);
  process_->program = program_of(options);
  process_->log = options.log;
  const long pidfd = ::syscall(SYS_pidfd_open, ::getpid(), 0);
  if (pidfd < 0)
    throw ClientError(Code::kUnavailable,
                      "a private daemon needs Linux 5.3; start heliographd and connect to it");
  const Fd owner{int(pidfd)};
  auto [ready, ready_end] = make_pipe();
  auto [log, log_end] = make_pipe();
  process_->folder = make_folder();
  process_->log_end = std::move(log);
  try {
    process_->spawn(options, owner.get(), ready_end.get(), log_end.get());
  } catch (...) {
    stop();
    throw;
  }
  ready_end.reset();
  log_end.reset();
  process_->reader = std::thread([process = process_.get()] { process->read_log(); });
  const std::string socket = socket_of(process_->read_ready(ready.get(), options.timeout));
  if (socket.empty()) {
    const auto left = end - std::chrono::steady_clock::now();
    const double patience = std::chrono::duration<double>(left).count();
    const ClientError error =
        death(process_->program + " did not listen within " + std::to_string(options.timeout) +
                  " s; raise LaunchOptions::timeout, or start it by hand to see what it waits for",
              std::clamp(patience, 0.0, 2.0));
    give_up();
    throw error;
  }
  process_->address = "unix://" + socket;
}

PrivateDaemon::~PrivateDaemon() { stop(); }

const std::string& PrivateDaemon::address() const { return process_->address; }

bool PrivateDaemon::is_dead() { return process_->reap(0.3); }

ClientError PrivateDaemon::death(const std::string& message, double patience) {
  ErrorDetails details;
  std::string text = message;
  const bool ended = process_->reap(patience);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));  // its last lines come by a pipe
  const std::lock_guard lock(process_->mutex);
  if (ended) {
    details.exit_code = process_->exit_code;
    text += " (" + describe(*process_->exit_code) + ")";
  }
  details.log.assign(process_->lines.begin(), process_->lines.end());
  text += details.log.empty() ? " and logged nothing" : "; its last lines:";
  for (const std::string& line : details.log) text += "\n  " + line;
  return {Code::kUnavailable, text, std::move(details)};
}

void PrivateDaemon::give_up() {
  if (process_->pid > 0 && !process_->reap(0)) ::kill(-process_->pid, SIGKILL);
  stop();
}

void PrivateDaemon::stop() {
  if (process_->pid > 0 && !process_->reap(0)) {
    ::kill(process_->pid, SIGTERM);
    if (!process_->reap(5)) {
      ::kill(process_->pid, SIGKILL);
      process_->reap(5);
    }
  }
  if (process_->reader.joinable()) process_->reader.join();
  std::error_code ignored;
  if (!process_->folder.empty()) std::filesystem::remove_all(process_->folder, ignored);
}

}  // namespace heliograph::client::wire
