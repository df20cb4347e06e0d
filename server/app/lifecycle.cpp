// Start, run and end of the daemon. See lifecycle.h.
#include "server/app/lifecycle.h"

#include <poll.h>
#include <sys/epoll.h>
#include <sys/signalfd.h>
#include <sys/socket.h>

#include <filesystem>

#include "server/app/grpc_server.h"
#include "server/app/metric_values.h"
#include "server/app/notify.h"
#include "server/app/reload.h"
#include "server/app/signals.h"
#include "server/app/sockets.h"
#include "server/calls/daemon.h"
#include "server/calls/decode_trial.h"
#include "server/calls/quick_calls.h"
#include "server/config/container.h"
#include "server/net/metrics_port.h"
#include "server/net/socket_files.h"

extern "C" {
// Options of jemalloc, which reads this before main(): freed pages return to the system after 1 s,
// those of large allocations at once, since each thread's arena would keep some.
extern const char* const malloc_conf;
const char* const malloc_conf =
    "background_thread:true,dirty_decay_ms:1000,muzzy_decay_ms:0,oversize_threshold:2097152";
}

namespace heliograph::server {
namespace {

using std::chrono::milliseconds;

constexpr auto kDrainPoll = milliseconds(10);
constexpr auto kLastCalls = milliseconds(500);
constexpr double kUnheardSeconds = 2;  // loop stall after which signals bypass it
constexpr unsigned kLastSeconds = 8;   // time limit for device, disk and the rest to end
constexpr auto kWarnEvery = std::chrono::hours(1);

/// Everything that runs once the sockets listen.
class Life {
 public:
  /// tls   null without TLS
  Life(Daemon& daemon, std::unique_ptr<Tls> tls)
      : daemon_(daemon), tls_(std::move(tls)), quick_calls_(daemon) {}

  [[nodiscard]] Status start(Sockets sockets, UniqueFd signals);
  [[nodiscard]] int run();

 private:
  [[nodiscard]] Status start_listening(Sockets sockets);
  void on_buffer_message(u64 session, const BufferMessage& word, ForeignFd fd);
  [[nodiscard]] Status start_metrics(ListeningSocket socket);
  [[nodiscard]] Status start_grpc();
  [[nodiscard]] Status listen(ListeningSocket socket, GrpcServer& server);
  [[nodiscard]] std::vector<GrpcServer*> servers() const;
  [[nodiscard]] Status watch_signals(UniqueFd signals);
  [[nodiscard]] Status watch_owner();
  void on_signal();
  void start_watchdog();
  void tick_without_loop(double still_seconds);
  void drain();
  void await_quiet(EventLoop::Clock::time_point deadline);
  void on_engine(const Status& status);
  void on_lost();
  void on_ready(bool is_ready);
  void warn_exposed();
  void end();

  Daemon& daemon_;
  std::unique_ptr<Tls> tls_;
  QuickCalls quick_calls_;
  UniqueFd signals_;
  std::unique_ptr<GrpcServer> local_;
  std::unique_ptr<GrpcServer> tcp_;  // null without --listen
  std::unique_ptr<ConnectionCount> connections_;
  std::vector<std::unique_ptr<Listener>> listeners_;
  std::unique_ptr<MetricsPort> metrics_;
  bool is_draining_ = false;
  bool is_hurried_ = false;  // by a second signal
  // Since when a signal is pending. Thread: the watchdog's.
  std::optional<EventLoop::Clock::time_point> unheard_;
  int exit_code_ = kExitOk;
};

Status Life::start(Sockets sockets, UniqueFd signals) {
  const Config& config = daemon_.config;
  daemon_.engine = std::make_unique<EngineSlot>(
      EngineOptions{.backend = config.backend,
                    .devices = config.devices,
                    .device = {.threads = config.threads,
                               .cache_bytes = config.limits.derived_bytes,
                               .static_triangles = config.limits.static_triangles,
                               .memory_bytes = config.device_memory,
                               .denoiser = config.denoiser},
                    .spread_samples = config.spread_samples},
      daemon_.log,
      [this](const Status& status) { daemon_.loop->post([this, status] { on_engine(status); }); });
  daemon_.decoder = Decoder::create(decoder_options(config));
  HELIO_TRY(start_grpc());
  daemon_.stall_monitor.start(*daemon_.loop);
  daemon_.health.start(*daemon_.engine, {.on_ready = [this](bool is_ready) { on_ready(is_ready); },
                                         .on_lost = [this] { on_lost(); }});
  try_decoder(daemon_);
  HELIO_TRY(start_listening(std::move(sockets)));
  if (config.is_exposed()) warn_exposed();
  HELIO_TRY(watch_signals(std::move(signals)));
  HELIO_TRY(watch_owner());
  start_watchdog();
  return {};
}

Status Life::start_grpc() {
  auto local = GrpcServer::start_local(daemon_);
  if (!local) return std::unexpected(local.error());
  local_ = std::move(*local);
  if (!daemon_.config.listen.empty()) {
    auto tcp = GrpcServer::start_tcp(daemon_, tls_ ? tls_->credentials(daemon_.tenants) : nullptr);
    if (!tcp) return std::unexpected(tcp.error());
    tcp_ = std::move(*tcp);
  }
  daemon_.journal_changed = [this](bool is_writing) {
    for (GrpcServer* server : servers()) server->set_durable(is_writing);
  };
  return {};
}

std::vector<GrpcServer*> Life::servers() const {
  return tcp_ ? std::vector{local_.get(), tcp_.get()} : std::vector{local_.get()};
}

void Life::on_buffer_message(u64 id, const BufferMessage& word, ForeignFd fd) {
  const auto session = daemon_.sessions.find(id);
  if (!session) return;
  if (fd && word.buffer == 0) return quick_calls_.serve(session, std::move(fd));
  if (fd) {
    const bool is_good = session->arrays().shared().take(word.buffer, word.number, fd.get());
    if (is_good && daemon_.recorder) daemon_.recorder->buffer(id, word.buffer, fd.get());
    return;
  }
  if (word.buffer == 0) {
    LocalChannel* channel = daemon_.local_channel.get();
    session->share_frames(
        [channel, id](u64 buffer, const SharedMemory* memory) {
          return channel->send(id, {buffer, memory ? memory->bytes().size() : 0}, memory);
        },
        [channel, id] { channel->poll(id); });
    (void)channel->send(id, {}, nullptr);
    return;
  }
  const auto frames = session->shared_frames();
  if (!frames) return;
  if (word.number == 0) return frames->give_up(word.buffer);
  if (word.number != BufferMessage::kUnmapped) return frames->give_back(word.buffer, word.number);
  // Returning an arena's pages to the kernel takes milliseconds.
  if (auto freed = frames->unmapped(word.buffer))
    (void)daemon_.pool.post(session->tenant()->id, [freed = std::move(freed)] {});
}

Status Life::start_listening(Sockets sockets) {
  const Limits& limits = daemon_.config.limits;
  const u32 limit = u32(limits.connections);
  auto local_channel =
      LocalChannel::start(*daemon_.loop, daemon_.log, std::move(sockets.local_channel),
                          {.total = limit, .per_peer = u32(limits.connections_per_peer)},
                          {[this](u64 session) { daemon_.sessions.detach(session); },
                           [this](u64 session, const BufferMessage& word, ForeignFd fd) {
                             on_buffer_message(session, word, std::move(fd));
                           }});
  if (!local_channel) return std::unexpected(local_channel.error());
  daemon_.local_channel = std::move(*local_channel);
  connections_ = std::make_unique<ConnectionCount>(
      *daemon_.loop, ConnectionCount::Limits{limit, u32(limits.connections_per_peer)});
  for (ListeningSocket& socket : sockets.tcp) HELIO_TRY(listen(std::move(socket), *tcp_));
  HELIO_TRY(listen(std::move(sockets.main), *local_));
  return sockets.metrics ? start_metrics(std::move(*sockets.metrics)) : Status();
}

Status Life::listen(ListeningSocket socket, GrpcServer& server) {
  auto listener = Listener::start(*daemon_.loop, daemon_.log, std::move(socket),
                                  [this, &server](ForeignFd connection, const Peer& peer) {
                                    if (connections_->add(connection.get(), peer))
                                      return server.serve(connection.release());
                                    daemon_.metrics.connection_refused();
                                  });
  if (!listener) return std::unexpected(listener.error());
  listeners_.push_back(std::move(*listener));
  return {};
}

Status Life::start_metrics(ListeningSocket socket) {
  if (!is_loopback(socket.fd.get()))
    daemon_.log.warning("whoever reaches the metrics' port may read it", {});
  const Limits& limits = daemon_.config.limits;
  const MetricsPort::Limits most{u32(limits.metrics_connections),
                                 u32(limits.metrics_connections_per_peer)};
  auto port = MetricsPort::start({*daemon_.loop, daemon_.log, std::move(socket), most}, [this] {
    return daemon_.metrics.text(metric_values(daemon_, connections_->open()));
  });
  if (!port) return std::unexpected(port.error());
  metrics_ = std::move(*port);
  return {};
}

Status Life::watch_signals(UniqueFd signals) {
  signals_ = std::move(signals);
  return daemon_.loop->watch(signals_.get(), EPOLLIN, [this](u32) { on_signal(); });
}

Status Life::watch_owner() {
  if (daemon_.config.owner_pidfd < 0) return {};
  return daemon_.loop->watch(daemon_.config.owner_pidfd, EPOLLIN, [this](u32) {
    daemon_.log.info("the owner ended");
    daemon_.loop->forget(daemon_.config.owner_pidfd);
    daemon_.loop->quit();
  });
}

void Life::warn_exposed() {
  daemon_.log.warning(kExposed);
  daemon_.loop->after(kWarnEvery, [this] { warn_exposed(); });
}

void Life::on_signal() {
  signalfd_siginfo info;
  if (::read(signals_.get(), &info, sizeof info) != sizeof info) return;
  daemon_.log.info(is_draining_ ? "second signal: ending at once" : "signal: draining",
                   {{"signal", info.ssi_signo}});
  if (!is_draining_) return drain();
  is_hurried_ = true;
  daemon_.loop->quit();
}

void Life::start_watchdog() {
  using Needs = Watchdog::Needs;
  daemon_.watchdog.start(
      {{"calls", Needs::kReadiness, [this] { return daemon_.gate.reactions().longest_seconds(); }},
       {"pool", Needs::kLiveness, [this] { return daemon_.pool.still_seconds(); }},
       {"log", Needs::kNothing, [this] { return daemon_.log.still_seconds(); }}},
      {.on_fault = [this](const std::string& fault) { daemon_.health.stand_still(fault); },
       .on_live =
           [this](bool is_live) {
             for (GrpcServer* server : servers()) server->set_live(is_live);
           },
       .on_tick = [this](double still) { tick_without_loop(still); }});
}

/// Drains in place of a stalled loop, which does not see the signal, using only what works without
/// the loop. A loop that resumes handles the signal itself.
void Life::tick_without_loop(double still_seconds) {
  pollfd signal{.fd = signals_.get(), .events = POLLIN, .revents = 0};
  if (still_seconds < kUnheardSeconds || ::poll(&signal, 1, 0) != 1) return unheard_.reset();
  const auto now = EventLoop::Clock::now();
  if (!unheard_) {
    unheard_ = now;
    daemon_.gate.close();
    daemon_.log.error("signal: draining, though the event loop stands still");
  }
  const std::chrono::duration<double> waited = now - *unheard_;
  if (daemon_.gate.active() > 0 && waited.count() < daemon_.config.drain_seconds) return;
  end_within(kLastSeconds);
  if (daemon_.journal) daemon_.journal->stop();
  daemon_.log.error("ending without the event loop");
  daemon_.log.flush();
  ::_exit(kExitSoftware);
}

void Life::drain() {
  is_draining_ = true;
  daemon_.health.drain();
  notify_supervisor("STOPPING=1");
  daemon_.gate.close();
  const auto limit = std::chrono::duration<double>(daemon_.config.drain_seconds);
  await_quiet(EventLoop::Clock::now() +
              std::chrono::duration_cast<EventLoop::Clock::duration>(limit));
}

void Life::await_quiet(EventLoop::Clock::time_point deadline) {
  if (daemon_.gate.active() == 0 || EventLoop::Clock::now() >= deadline)
    return daemon_.loop->quit();
  daemon_.loop->after(kDrainPoll, [this, deadline] { await_quiet(deadline); });
}

void Life::on_engine(const Status& status) {
  if (status) return daemon_.health.first_pixel();
  on_lost();
}

void Life::on_ready(bool is_ready) {
  for (GrpcServer* server : servers()) server->set_ready(is_ready);
  if (is_ready) notify_supervisor("READY=1");
}

void Life::on_lost() {
  daemon_.log.error("the device is lost for good", {{"reason", daemon_.health.not_ready()}});
  exit_code_ = kExitDevice;
  daemon_.watchdog.stop();  // saving blocks the loop
  daemon_.save_scenes();
  daemon_.loop->quit();
}

int Life::run() {
  daemon_.loop->run();
  end();
  return exit_code_;
}

/// Ends everything. Cancels jobs first, so that every call can end before gRPC does; a hanging
/// device or disk is not waited for beyond kLastSeconds.
void Life::end() {
  is_hurried_ ? hurry() : end_within(kLastSeconds);
  hurry_at_signal();
  daemon_.watchdog.stop();
  if (daemon_.journal) daemon_.journal->stop();  // while the sessions still have their edits
  daemon_.gate.close();
  listeners_.clear();
  metrics_.reset();
  daemon_.local_channel->stop_listening();
  daemon_.sessions.close_all();
  quick_calls_.stop();
  for (GrpcServer* server : servers()) server->shutdown(kLastCalls);
  daemon_.pool.stop();
  daemon_.engine.reset();
  daemon_.decoder = nullptr;
  connections_.reset();
  tcp_.reset();
  local_.reset();
}

int refuse(const Error& error) {
  fmt::print(stderr, "heliographd: {}{}{}\n", error.where, error.where.empty() ? "" : ": ",
             error.message);
  switch (error.code) {
    case Code::kInvalidArgument:
    case Code::kPermissionDenied:
      return kExitUsage;
    case Code::kAlreadyExists:
    case Code::kUnavailable:
      return kExitUnavailable;
    default:
      return error.where == "--state-dir" ? kExitData : kExitSoftware;
  }
}

}  // namespace

int run(Config config) {
  if (!config.listen.empty() || !config.tenants_file.empty()) hide_memory();
  UniqueFd signals = block_signals();
  SocketFiles files;
  auto sockets = open_sockets(config, files);
  if (!sockets) return refuse(sockets.error());
  Reload reload(config);
  auto identities = load_identities(config);
  if (!identities) return refuse(identities.error());
  std::unique_ptr<Tls> tls;
  if (!config.tls_cert.empty()) {
    auto loaded = Tls::load(config);
    if (!loaded) return refuse(loaded.error());
    tls = std::move(*loaded);
  }
  auto loop = EventLoop::create();
  if (!loop) return refuse(loop.error());
  AssetRoot root;
  if (!config.asset_root.empty()) {
    auto opened = AssetRoot::open(config.asset_root);
    if (!opened) return refuse(opened.error());
    root = std::move(*opened);
  }
  const std::vector<Fitted> fitted = fit(config, this_machine());
  Daemon daemon(std::move(config), std::move(*identities), std::move(*loop));
  daemon.log_fitted(fitted);
  daemon.asset_root = std::move(root);
  if (!daemon.config.state_dir.empty())
    if (auto opened = daemon.open_journal(); !opened) return refuse(opened.error());
  if (!daemon.config.record.empty())
    if (auto opened = daemon.open_recorder(); !opened) return refuse(opened.error());
  reload.start(daemon, tls.get());
  announce(daemon.config, *sockets);
  Life life(daemon, std::move(tls));
  if (auto started = life.start(std::move(*sockets), std::move(signals)); !started)
    return refuse(started.error());
  return life.run();
}

}  // namespace heliograph::server
