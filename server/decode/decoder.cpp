#include "server/decode/decoder.h"

#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <mutex>
#include <thread>

#include "server/decode/result.h"
#include "server/decode/zygote_process.h"

namespace heliograph::server {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kHelloSeconds = 5;
constexpr u64 kMessageBytes = 256ull << 20;  // of a result, beside its arrays

struct Task {
  DecodeJob job;
  std::function<void(Expected<Decoded>)> done;
  std::stop_token stop;
};

/// "was killed by SIGSEGV", for the message.
std::string how_it_died(int status) {
  if (WIFSIGNALED(status)) {
    const char* name = sigabbrev_np(WTERMSIG(status));
    return fmt::format("was killed by SIG{}", name ? name : std::to_string(WTERMSIG(status)));
  }
  if (WIFEXITED(status)) return fmt::format("exited with {}", WEXITSTATUS(status));
  return "could not be started";
}

decode::Limits to_proto(const LoadLimits& limits) {
  decode::Limits message;
  message.set_bytes(limits.bytes);
  message.set_texels(limits.texels);
  message.set_vertices(limits.vertices);
  message.set_triangles(limits.triangles);
  message.set_entities(limits.entities);
  message.set_keys(limits.keys);
  message.set_json_bytes(limits.json_bytes);
  return message;
}

Expected<Fd> make_job_region(const DecodeJob& job, const DecoderOptions& options) {
  decode::Job message;
  std::vector<Bytes> files;
  for (const DecodeFile& file : job.files) {
    message.add_paths(file.path);
    message.add_sizes(file.bytes->bytes().size());
    files.push_back(file.bytes->bytes());
  }
  message.set_format(job.format);
  message.set_up(job.up);
  message.set_units(job.units);
  *message.mutable_limits() = to_proto(options.limits);
  return write_region(message, files);
}

/// Wakes a poll when a stop is requested.
class StopEvent {
 public:
  StopEvent(const std::stop_token& mine, const std::stop_token& pool)
      : event_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
        on_mine_(mine, Signal{event_.get()}),
        on_pool_(pool, Signal{event_.get()}) {}
  [[nodiscard]] int fd() const { return event_.get(); }

 private:
  struct Signal {
    int fd;
    void operator()() const {
      const u64 one = 1;
      (void)!write(fd, &one, sizeof one);
    }
  };
  const Fd event_;
  std::stop_callback<Signal> on_mine_, on_pool_;
};

/// How one child's run ended.
struct Outcome {
  enum class Kind { kResult, kDied, kCancelled, kDeadline, kZygoteLost } kind;
  Fd region{};
  int status = 0;
};

/// Waits for one child; kills it when it must not go on.
Outcome wait_for_child(int socket, int stop_event, Clock::time_point deadline) {
  Fd process;
  const auto kill_child = [&] {
    if (process) syscall(SYS_pidfd_send_signal, process.get(), SIGKILL, nullptr, 0);
  };
  while (true) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
    pollfd events[] = {{socket, POLLIN, 0}, {stop_event, POLLIN, 0}};
    const int ready = poll(events, 2, int(std::max<i64>(left.count(), 0)));
    if (ready < 0 && errno == EINTR) continue;
    if (events[1].revents) {
      kill_child();
      return {Outcome::Kind::kCancelled};
    }
    if (ready <= 0) {
      kill_child();
      return {Outcome::Kind::kDeadline};
    }
    auto packet = receive_packet(socket);
    if (!packet || !*packet) return {Outcome::Kind::kZygoteLost};
    auto& [kind, bytes, fds] = **packet;
    if (kind == PacketKind::kStarted && fds.size() == 1) process = std::move(fds[0]);
    if (kind == PacketKind::kResult) return {Outcome::Kind::kResult};
    if (kind == PacketKind::kExited && bytes.size() == sizeof(int)) {
      Outcome outcome{Outcome::Kind::kDied};
      std::memcpy(&outcome.status, bytes.data(), sizeof(int));
      return outcome;
    }
  }
}

}  // namespace

/// Locks: zygote_mutex_ for the zygote pointer, queue_mutex_ for the queue; never both.
class Decoder::Impl {
 public:
  Impl(DecoderOptions options, std::shared_ptr<const ZygoteProcess> zygote)
      : options_(std::move(options)), zygote_(std::move(zygote)) {
    const unsigned threads = std::clamp(std::thread::hardware_concurrency(), 2u, 8u);
    for (unsigned i = 0; i < threads; ++i) {
      pool_.emplace_back([this](const std::stop_token& stop) { work(stop); });
    }
  }
  ~Impl() {
    for (std::jthread& thread : pool_) thread.request_stop();
    for (std::jthread& thread : pool_) thread.join();
    for (Task& task : queue_) {
      task.done(fail(Code::kCancelled, "", "the decoder is shutting down"));
    }
  }

  void push(Task task) {
    {
      const std::lock_guard lock(queue_mutex_);
      queue_.push_back(std::move(task));
    }
    waiting_.notify_one();
  }

  [[nodiscard]] std::shared_ptr<const ZygoteProcess> zygote() const {
    const std::lock_guard lock(zygote_mutex_);
    return zygote_;
  }

 private:
  void work(const std::stop_token& stop) {
    while (true) {
      Task task;
      {
        std::unique_lock lock(queue_mutex_);
        if (!waiting_.wait(lock, stop, [&] { return !queue_.empty(); })) return;
        if (stop.stop_requested()) return;
        task = std::move(queue_.front());
        queue_.pop_front();
      }
      task.done(run(task, stop));
    }
  }

  Expected<Decoded> run(const Task& task, const std::stop_token& pool_stop) {
    if (task.job.files.empty()) return fail(Code::kInvalidArgument, "files", "the bundle is empty");
    if (task.stop.stop_requested()) return cancelled();
    const auto region = make_job_region(task.job, options_);
    if (!region) return std::unexpected(region.error());
    const StopEvent stop(task.stop, pool_stop);
    constexpr int kAttempts = 2;  // the second on a fresh zygote
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      const std::shared_ptr<const ZygoteProcess> process = zygote();
      Expected<Outcome> outcome = run_once(*process, region->get(), stop.fd());
      if (!outcome) return std::unexpected(std::move(outcome).error());
      if (outcome->kind != Outcome::Kind::kZygoteLost) return conclude(*outcome, task.job);
      HELIO_TRY(restart(process));
    }
    return fail(Code::kUnavailable, "", "the decoder keeps dying; see the daemon's log");
  }

  Expected<Outcome> run_once(const ZygoteProcess& process, int region, int stop_event) const {
    auto sockets = socket_pair();
    if (!sockets) return std::unexpected(std::move(sockets).error());
    auto& [mine, theirs] = *sockets;
    auto result = make_region();
    if (!result) return std::unexpected(std::move(result).error());
    if (!process.launch(theirs.get(), region, result->get()))
      return Outcome{Outcome::Kind::kZygoteLost};
    theirs = Fd();  // so that the end of the stream is seen
    const auto deadline =
        Clock::now() + std::chrono::duration_cast<Clock::duration>(
                           std::chrono::duration<double>(options_.deadline_seconds));
    Outcome outcome = wait_for_child(mine.get(), stop_event, deadline);
    outcome.region = std::move(*result);
    return outcome;
  }

  Expected<Decoded> conclude(const Outcome& outcome, const DecodeJob& job) const {
    const std::string& path = job.files.front().path;
    switch (outcome.kind) {
      case Outcome::Kind::kResult: {
        if (const Status sealed = seal_region(outcome.region.get()); !sealed)
          return fail(Code::kInternal, path, sealed.error().message);
        auto region = Region::map(outcome.region.get(), options_.limits.bytes + kMessageBytes);
        if (!region) return fail(Code::kInternal, path, region.error().message);
        return read_result(*region, job);
      }
      case Outcome::Kind::kDied:
        return fail(
            Code::kInvalidArgument, path,
            fmt::format("'{}' is malformed: its decoder {}", path, how_it_died(outcome.status)));
      case Outcome::Kind::kDeadline:
        return fail(
            Code::kDeadlineExceeded, path,
            fmt::format("'{}' did not decode within {} s", path, options_.deadline_seconds));
      case Outcome::Kind::kCancelled:
        return cancelled();
      case Outcome::Kind::kZygoteLost:
        break;
    }
    return fail(Code::kUnavailable, path, "the decoder died");
  }

  static std::unexpected<Error> cancelled() {
    return fail(Code::kCancelled, "", "the decode was cancelled");
  }

  /// Starts a new zygote unless somebody did since `lost` was seen.
  Status restart(const std::shared_ptr<const ZygoteProcess>& lost) {
    const std::lock_guard lock(zygote_mutex_);
    if (zygote_ != lost) return {};
    auto fresh = ZygoteProcess::start(options_);
    if (!fresh) return std::unexpected(std::move(fresh).error());
    zygote_ = std::move(*fresh);
    return {};
  }

  const DecoderOptions options_;
  mutable std::mutex zygote_mutex_;
  std::shared_ptr<const ZygoteProcess> zygote_;
  std::mutex queue_mutex_;
  std::condition_variable_any waiting_;
  std::deque<Task> queue_;
  std::vector<std::jthread> pool_;
};

Expected<std::unique_ptr<Decoder>> Decoder::create(const DecoderOptions& options) {
  auto zygote = ZygoteProcess::start(options);
  if (!zygote) return std::unexpected(std::move(zygote).error());
  return std::unique_ptr<Decoder>(new Decoder(std::make_unique<Impl>(options, std::move(*zygote))));
}

Decoder::Decoder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Decoder::~Decoder() = default;

void Decoder::decode(DecodeJob job, std::function<void(Expected<Decoded>)> done,
                     std::stop_token stop) {
  impl_->push({.job = std::move(job), .done = std::move(done), .stop = std::move(stop)});
}

std::vector<std::string> Decoder::sandbox() const {
  const decode::Hello hello = impl_->zygote()->hello(kHelloSeconds);
  return {hello.sandbox().begin(), hello.sandbox().end()};
}
std::vector<std::string> Decoder::refused() const {
  const decode::Hello hello = impl_->zygote()->hello(kHelloSeconds);
  return {hello.refused().begin(), hello.refused().end()};
}
std::string Decoder::versions() const { return impl_->zygote()->hello(kHelloSeconds).versions(); }

}  // namespace heliograph::server
