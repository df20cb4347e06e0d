// Makes the parts of the daemon from its Config. Called by main.
#include "server/calls/daemon.h"

#include <fmt/format.h>
#include <sys/random.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <thread>

#include "server/config/version.h"
#include "server/scene/recovery.h"
#include "server/scene/scene_info.h"

namespace heliograph::server {
namespace {

constexpr u64 kSweepSeconds = 1;

u64 random_number() {
  u64 number = 0;
  [[maybe_unused]] const auto size = ::getrandom(&number, sizeof number, 0);
  return number;
}

ReplyLimits reply_limits(const Limits& limits) { return {limits.replies, limits.reply_bytes}; }

Scenes::Options scene_options(const Limits& limits) {
  return {.scene = {.entities = u32(limits.entities),
                    .array_bytes = limits.array_bytes,
                    .revisions = u32(limits.revisions)},
          .replies = reply_limits(limits),
          .queue = u32(limits.calls_per_session),
          .events = {.events = limits.watch_events, .bytes = limits.watch_bytes}};
}

Sessions::Options session_options(const Config& config) {
  return {.grace_seconds = config.grace_seconds,
          .session = {.calls = u32(config.limits.calls_per_session),
                      .shared_bytes = config.limits.shared_bytes,
                      .replies = reply_limits(config.limits)}};
}

}  // namespace

Daemon::Daemon(Config settings, Identities identities, std::unique_ptr<EventLoop> event_loop)
    : config(std::move(settings)),
      instance(random_number()),
      log(config.log_level, config.log_json,
          {.bytes = config.limits.log_bytes, .value_bytes = config.limits.log_value_bytes}),
      loop(std::move(event_loop)),
      pool(std::clamp(std::thread::hardware_concurrency(), 2u, 16u), u32(config.limits.pool_queue)),
      scenes(pool, scene_options(config.limits)),
      tenants(config.limits, std::move(identities)),
      sessions(*loop, session_options(config),
               [this](const EndedSession& session) {
                 log.info("session ended",
                          {{"client", session.client}, {"tenant", session.tenant->name}});
                 if (recorder) recorder->end_session(session.id);
                 scenes.end_session(session.id);
               }),
      gate(tenants, sessions),
      call_log(log, metrics, call_log_options()),
      health(*loop, log,
             {.lost_seconds = double(config.limits.lost_seconds),
              .hang_seconds = double(config.limits.hang_seconds),
              .probe_seconds = double(config.limits.probe_seconds)}),
      watchdog(*loop, log,
               {.hang_seconds = double(config.limits.hang_seconds),
                .stuck_seconds = double(config.limits.stuck_seconds)}) {
  sweep_uploads();
}

CallLog::Options Daemon::call_log_options() {
  return {.slow_seconds = double(config.limits.slow_call_seconds),
          .slow_render_seconds = double(config.limits.slow_render_seconds),
          .scene_name = [this](u64 scene, u64 session) -> std::string {
            const auto asker = sessions.find(session);
            if (!asker) return "";
            const auto entry = scenes.find(scene, *asker);
            return entry ? (*entry)->name : "";
          }};
}

Status Daemon::open_journal() {
  auto opened = Journal::open(
      {.folder = config.state_dir,
       .snapshot_records = config.limits.snapshot_edits,
       .snapshot_bytes = config.limits.snapshot_bytes,
       .queue = config.limits.journal_queue,
       .reserve = config.limits.disk_reserve_bytes,
       .spare = config.limits.disk_spare_bytes,
       .disk = [this](const std::string& tenant) { return tenants.named(tenant)->ledger.disk; }},
      pool, log);
  if (!opened) return std::unexpected(std::move(opened).error());
  // Recovered objects were admitted by an earlier daemon: none of them is refused.
  tenants.ledger().lift();
  auto recovered = recover(**opened, {.scenes = scenes, .tenants = tenants});
  tenants.ledger().set_totals(config.limits);
  if (!recovered) return std::unexpected(std::move(recovered).error());
  journal = std::move(*opened);
  log.info(
      "recovered",
      {{"scenes", recovered->scenes}, {"edits", recovered->records}, {"saved", recovered->saved}});
  if (recovered->dropped > 0)
    log.error("saved scenes are lost", {{"scenes", recovered->dropped},
                                        {"reason", recovered->because.error().where + ": " +
                                                       recovered->because.error().message}});
  sessions.resume_for(double(config.limits.resume_seconds), std::move(recovered->sessions));
  sessions.hold(recovered->owners, [this](u64 session) { scenes.free_private(session); });
  return journal->start([this](const std::set<u64>& changed) { return scenes.capture(changed); },
                        [this](const Status& status) {
                          loop->post([this, is_writing = bool(status)] {
                            if (journal_changed) journal_changed(is_writing);
                          });
                          if (status)
                            log.warning("the journal is written again");
                          else
                            log.error("durable scenes are read-only",
                                      {{"reason", status.error().message}});
                        });
}

void end_within(u32 seconds) {
  std::signal(SIGALRM, [](int) { ::_exit(kExitDevice); });
  ::alarm(seconds);
}

void Daemon::save_scenes() {
  gate.close();
  end_within(u32(config.limits.save_seconds));
  std::vector<SceneState> states = scenes.capture_last();
  if (states.empty()) return;
  if (!journal)
    return log.error("scenes are lost: there is no state directory (--state-dir) to save them in",
                     {{"scenes", states.size()}});
  const auto start = EventLoop::Clock::now();
  const Journal::Saved saved = journal->save(std::move(states), config.limits.saved_bytes);
  const std::chrono::duration<double> took = EventLoop::Clock::now() - start;
  if (saved.scenes > 0)
    log.warning("scenes are saved for the next daemon",
                {{"scenes", saved.scenes}, {"bytes", saved.bytes}, {"seconds", took.count()}});
  if (saved.lost > 0)
    log.error("scenes are lost: they could not be saved",
              {{"scenes", saved.lost}, {"reason", saved.because.error().message}});
}

void Daemon::log_fitted(const std::vector<Fitted>& limits) {
  std::string lowered;
  for (const Fitted& each : limits) {
    if (each.is_kept)
      log.warning("a limit is set to more than its part of what there is",
                  {{"limit", each.name}, {"value", each.from}, {"part", each.to}});
    else
      lowered += fmt::format("{}{}={}", lowered.empty() ? "" : " ", each.name, each.to);
  }
  if (!lowered.empty()) log.info("limits are lowered to what there is", {{"limits", lowered}});
}

Status Daemon::open_recorder() {
  v1::RecordHeader header;
  header.set_daemon(kVersion);
  header.set_backend(config.backend);
  const auto defaults = list_limits({});
  for (const auto& limit : list_limits(config.limits))
    if (std::ranges::find(defaults, limit) == defaults.end())
      (*header.mutable_limits())[limit.first] = limit.second;
  auto opened = Recorder::open(
      {.path = config.record, .bytes = config.limits.record_bytes, .header = std::move(header)},
      log);
  if (!opened) return std::unexpected(std::move(opened).error());
  recorder = std::move(*opened);
  return {};
}

void Daemon::sweep_uploads() {
  // When the pool is full, memory is freed at the next sweep.
  [[maybe_unused]] const auto posted = pool.post(WorkPool::kDaemon, [this] {
    for (const auto& session : sessions.list()) session->arrays().sweep();
  });
  loop->after(std::chrono::seconds(kSweepSeconds), [this] { sweep_uploads(); });
}

void Daemon::restore_requests(Session& session) {
  for (const ScenePtr& scene : scenes.list(session))
    if (scene->made_by.session == session.id())
      session.requests().restore(scene->made_by.request_id, scene->made_by.method,
                                 scene_info(scenes, *scene, session).SerializeAsString());
}

}  // namespace heliograph::server
