// What the handlers share. Built once by main, passed by reference; destroyed in reverse order.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "server/config/config.h"
#include "server/config/container.h"
#include "server/decode/decoder.h"
#include "server/device/engine_slot.h"
#include "server/device/health.h"
#include "server/journal/journal.h"
#include "server/net/local_channel.h"
#include "server/observe/call_log.h"
#include "server/observe/call_watch.h"
#include "server/observe/metrics.h"
#include "server/observe/recorder.h"
#include "server/os/event_loop.h"
#include "server/os/log.h"
#include "server/os/watchdog.h"
#include "server/os/work_pool.h"
#include "server/scene/scenes.h"
#include "server/session/gate.h"
#include "server/session/session.h"
#include "server/store/asset_root.h"

namespace heliograph::server {

struct Daemon {
  const Config config;
  const u64 instance;  // random; changes when the daemon restarts
  const Log log;
  Metrics metrics;
  std::unique_ptr<EventLoop> loop;
  WorkPool pool;
  Scenes scenes;
  Tenants tenants;
  std::unique_ptr<Recorder> recorder;  // null unless it records
  Sessions sessions;
  Gate gate;
  const CallLog call_log;
  CallWatch watch;
  Health health;
  Watchdog watchdog;
  std::unique_ptr<LocalChannel> local_channel;
  std::unique_ptr<EngineSlot> engine;
  AssetRoot asset_root;
  Expected<std::unique_ptr<Decoder>> decoder;
  std::unique_ptr<Journal> journal;  // null without a state directory
  /// Called by the loop when durable scenes become read-only, and when they are written again. Set
  /// before the loop runs.
  std::function<void(bool is_writing)> journal_changed;

  Daemon(Config settings, Identities identities, std::unique_ptr<EventLoop> event_loop);
  Daemon(const Daemon&) = delete;
  ~Daemon() { pool.stop(); }  // its tasks use members that go before it
  /// Recovers what the state directory holds. INTERNAL: it is damaged.
  [[nodiscard]] Status open_journal();
  /// Saves the scenes that are not durable for the next daemon, and refuses what comes from now on;
  /// the process ends when that takes longer than it may. The log says what is lost.
  void save_scenes();
  /// Logs limits that were larger than their part of what there is.
  void tell_fitted(const std::vector<Fitted>& limits);
  /// Begins to record. INVALID_ARGUMENT: there is no place for it.
  [[nodiscard]] Status open_recorder();
  /// A question is answered from this revision, which a recording keeps.
  void note_revision(const grpc::ServerContextBase& context, Revision revision) const {
    if (recorder) recorder->revision(&context, revision);
  }
  /// So that a session that was resumed may repeat the calls that made its scenes.
  void restore_requests(Session& session);

 private:
  [[nodiscard]] CallLog::Options call_log_options();
  /// Once a second: what sessions brought and nobody needs goes (recent.h).
  void sweep_uploads();
};

/// Ends the process then, with kExitDevice, whatever hangs.
void end_within(u32 seconds);

}  // namespace heliograph::server
