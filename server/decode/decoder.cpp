#include "server/decode/decoder.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <thread>

#include "server/decode/child_process.h"
#include "server/decode/decoded.pb.h"
#include "server/decode/queue.h"
#include "server/decode/result.h"

namespace heliograph::server {
namespace {

using Clock = std::chrono::steady_clock;
using ChildPtr = std::unique_ptr<ChildProcess>;

constexpr double kHelloSeconds = 5;

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

Status begin(ChildProcess& child, const DecodeJob& job, const LoadLimits& limits) {
  decode::Job message;
  std::vector<Bytes> files;
  for (const DecodeFile& file : job.files) {
    message.add_paths(file.path);
    files.push_back(file.bytes ? file.bytes->bytes() : Bytes());
    message.add_sizes(files.back().size());
  }
  message.set_format(job.format);
  message.set_up(job.up);
  message.set_units(job.units);
  message.set_layer(job.layer);
  message.set_variant(job.variant);
  message.set_surface(job.surface);
  *message.mutable_limits() = to_proto(limits);
  return child.begin(message, files);
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

Clock::time_point after(double seconds) {
  return Clock::now() +
         std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

/// Waits for the child's next packet; nullopt when it ended. CANCELLED, DEADLINE_EXCEEDED.
Expected<std::optional<Packet>> await_packet(const ChildProcess& child, const StopEvent& stop,
                                             Clock::time_point deadline) {
  pollfd events[] = {{child.socket(), POLLIN, 0}, {stop.fd(), POLLIN, 0}};
  int ready;
  do {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
    ready = poll(events, 2, int(std::max<i64>(left.count(), 0)));
  } while (ready < 0 && errno == EINTR);
  if (events[1].revents) return fail(Code::kCancelled, "", "the decode was cancelled");
  if (ready <= 0) return fail(Code::kDeadlineExceeded, "", "");
  return receive_packet(child.socket());
}

/// Returns the error of missing layers, with the operator's remedy.
Error describe_missing(const decode::Hello& hello) {
  std::vector<std::string_view> needed, optional;
  for (const std::string& missing : hello.missing()) {
    const std::string_view layer = name_of(missing);
    (std::ranges::find(kOptionalLayers, layer) != kOptionalLayers.end() ? optional : needed)
        .push_back(layer);
  }
  std::string remedy;
  if (!needed.empty())
    remedy = fmt::format("let the container or service use {}, which no decode goes without",
                         fmt::join(needed, ", "));
  if (!optional.empty())
    remedy += fmt::format("{}allow {}, or start heliographd with --decode-without {}",
                          remedy.empty() ? "" : "; ", fmt::join(optional, ", "),
                          fmt::join(optional, ","));
  return {.code = Code::kFailedPrecondition,
          .message = fmt::format(
              "no file is decoded, because the kernel refuses a layer of the sandbox ({}): {}",
              fmt::join(hello.missing(), "; "), remedy),
          .where = ""};
}

std::unexpected<Error> at(const std::string& path, Error error) {
  error.where = path;
  return std::unexpected(std::move(error));
}

}  // namespace

/// Lock order: state_mutex_ and spare_mutex_ are never held together.
class Decoder::Impl {
 public:
  explicit Impl(DecoderOptions options)
      : options_(std::move(options)),
        queue_({.running = options_.tenant_processes, .waiting = options_.tenant_waiting}) {
    for (u64 i = 0; i < options_.processes; ++i)
      threads_.emplace_back([this](const std::stop_token& stop) { work(stop); });
  }
  ~Impl() {
    for (std::jthread& thread : threads_) thread.request_stop();
    for (std::jthread& thread : threads_) thread.join();
    for (DecodeTask& task : queue_.rest())
      task.done(fail(Code::kCancelled, "", "the decoder is shutting down"));
  }

  void push(DecodeTask task) {
    if (auto pushed = queue_.push(task); !pushed) task.done(std::unexpected(pushed.error()));
  }

  [[nodiscard]] DecoderState state() {
    std::unique_lock lock(state_mutex_);
    known_.wait_until(lock, after(kHelloSeconds), [&] { return is_known_; });
    if (is_known_) return state_;
    return {.works = fail(Code::kUnavailable, "", "heliograph-decode does not answer")};
  }

 private:
  void work(const std::stop_token& stop) {
    while (auto task = queue_.take(stop)) {
      ChildPtr child;
      if (task->read)
        task->read();
      else
        task->done(run(*task, child, stop));
      child.reset();  // frees its memory after the reply
      queue_.end(task->job.tenant);
    }
  }

  Expected<Decoded> run(const DecodeTask& task, ChildPtr& child, const std::stop_token& pool) {
    if (task.job.files.empty()) return fail(Code::kInvalidArgument, "files", "the bundle is empty");
    const std::string& path = task.job.files.front().path;
    if (task.stop.stop_requested()) return fail(Code::kCancelled, "", "the decode was cancelled");
    const StopEvent stop(task.stop, pool);
    auto ready = take_child(stop);
    if (!ready) return at(path, ready.error());
    child = std::move(*ready);
    const auto deadline = after(options_.deadline_seconds);
    if (auto begun = begin(*child, task.job, options_.limits); !begun)
      return at(path, begun.error());
    make_spare();
    return converse(task.job, *child, stop, deadline);
  }

  Expected<Decoded> converse(const DecodeJob& job, ChildProcess& child, const StopEvent& stop,
                             Clock::time_point deadline) const {
    const std::string& path = job.files.front().path;
    std::shared_ptr<const void> paid;
    while (true) {
      const auto packet = await_packet(child, stop, deadline);
      if (!packet && packet.error().code == Code::kDeadlineExceeded)
        return fail(Code::kDeadlineExceeded, path,
                    fmt::format("'{}' did not decode within {} s (limit decode_seconds)", path,
                                options_.deadline_seconds));
      if (!packet) return at(path, packet.error());
      if (!*packet)
        return fail(Code::kInvalidArgument, path,
                    fmt::format("'{}' is malformed: its decoder {}", path, child.how_it_ended()));
      const auto& [kind, bytes] = **packet;
      if (kind == PacketKind::kResult) {
        const auto region = child.result();
        if (!region) return fail(Code::kInternal, path, region.error().message);
        return read_result(*region, job, std::move(paid));
      }
      u64 needed = 0;
      if (kind != PacketKind::kNeed || bytes.size() != sizeof needed)
        return fail(Code::kInternal, path, "its decoder says what no decoder says");
      std::memcpy(&needed, bytes.data(), sizeof needed);
      auto room = job.pay(needed);
      if (!room) return at(path, room.error());
      paid = std::move(*room);
      if (auto granted = child.grant(needed); !granted) return at(path, granted.error());
    }
  }

  /// Returns a confined child: the spare one, or a new one if that died.
  Expected<ChildPtr> take_child(const StopEvent& stop) {
    ChildPtr spare;
    {
      const std::lock_guard lock(spare_mutex_);
      spare = std::move(spare_);
    }
    if (spare && greet(*spare, stop) && !spare->has_ended()) return spare;
    auto child = ChildProcess::start(options_);
    if (!child) return std::unexpected(note(child.error()));
    if (auto greeted = greet(**child, stop); !greeted) return std::unexpected(greeted.error());
    return std::move(*child);
  }

  /// Reads its Hello and keeps it.
  Status greet(ChildProcess& child, const StopEvent& stop) {
    const auto packet = await_packet(child, stop, after(kHelloSeconds));
    if (!packet && packet.error().code == Code::kCancelled) return std::unexpected(packet.error());
    decode::Hello hello;
    if (!packet || !*packet || (*packet)->kind != PacketKind::kHello ||
        !hello.ParseFromString((*packet)->bytes))
      return std::unexpected(note({.code = Code::kUnavailable,
                                   .message = fmt::format("no file is decoded, because {} {} "
                                                          "before it was confined",
                                                          options_.program, child.how_it_ended()),
                                   .where = ""}));
    DecoderState state{.sandbox = {hello.sandbox().begin(), hello.sandbox().end()},
                       .refused = {hello.refused().begin(), hello.refused().end()},
                       .versions = hello.versions()};
    if (hello.missing_size() > 0) state.works = std::unexpected(describe_missing(hello));
    const Status works = state.works;
    keep(std::move(state));
    return works;
  }

  Error note(Error error) {
    keep({.works = std::unexpected(error)});
    return error;
  }
  void keep(DecoderState state) {
    {
      const std::lock_guard lock(state_mutex_);
      state_ = std::move(state);
      is_known_ = true;
    }
    known_.notify_all();
  }

  /// Starts the spare child, whose libraries load while the current job is decoded. Called only by
  /// threads that live as long as this, since a child dies with the thread that started it.
  void make_spare() {
    const std::lock_guard lock(spare_mutex_);
    if (spare_) return;
    if (auto child = ChildProcess::start(options_)) spare_ = std::move(*child);
  }

  const DecoderOptions options_;
  DecodeQueue queue_;
  std::mutex state_mutex_;
  std::condition_variable known_;
  bool is_known_ = false;
  DecoderState state_;
  std::mutex spare_mutex_;
  ChildPtr spare_;
  std::vector<std::jthread> threads_;
};

Expected<std::unique_ptr<Decoder>> Decoder::create(const DecoderOptions& options) {
  if (access(options.program.c_str(), X_OK) != 0)
    return fail(Code::kUnavailable, "", system_message(options.program.c_str()));
  return std::unique_ptr<Decoder>(new Decoder(std::make_unique<Impl>(options)));
}

Decoder::Decoder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Decoder::~Decoder() = default;

void Decoder::decode(DecodeJob job, std::function<void(Expected<Decoded>)> done,
                     std::stop_token stop) {
  impl_->push({.job = std::move(job), .done = std::move(done), .stop = std::move(stop)});
}

void Decoder::read(u64 tenant, std::function<void()> work, std::function<void(Status)> refused) {
  DecodeJob job;
  job.tenant = tenant;
  impl_->push({.job = std::move(job),
               .done = [refused = std::move(refused)](
                           const Expected<Decoded>& why) { refused(std::unexpected(why.error())); },
               .stop = {},
               .read = std::move(work)});
}

void Decoder::try_out(std::function<void(Status)> done) {
  static constexpr std::string_view kTriangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  const auto bytes = std::as_bytes(std::span(kTriangle));
  DecodeJob job;
  job.files.push_back({"triangle.obj", std::make_shared<const Buffer>(nullptr, bytes)});
  decode(std::move(job),
         [done = std::move(done)](const Expected<Decoded>& decoded) {
           done(decoded ? Status() : std::unexpected(decoded.error()));
         },
         {});
}

DecoderState Decoder::state() const { return impl_->state(); }

}  // namespace heliograph::server
