// State shared by the handlers. Built once by main, passed by reference; destroyed in reverse
// order.
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
#include "server/observe/metrics.h"
#include "server/observe/recorder.h"
#include "server/observe/stall_monitor.h"
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
  std::unique_ptr<Recorder> recorder;  // null unless --record is given
  Sessions sessions;
  Gate gate;
  const CallLog call_log;
  StallMonitor stall_monitor;
  Health health;
  Watchdog watchdog;
  std::unique_ptr<LocalChannel> local_channel;
  std::unique_ptr<EngineSlot> engine;
  AssetRoot asset_root;
  Expected<std::unique_ptr<Decoder>> decoder;
  std::unique_ptr<Journal> journal;  // null without a state directory
  /// Called by the loop when durable scenes become read-only (false) and writable again (true). Set
  /// before the loop runs.
  std::function<void(bool is_writing)> journal_changed;

  Daemon(Config settings, Identities identities, std::unique_ptr<EventLoop> event_loop);
  Daemon(const Daemon&) = delete;
  ~Daemon() { pool.stop(); }  // its tasks use members that are destroyed before it
  /// Opens the journal and recovers its scenes. INTERNAL: it is damaged.
  [[nodiscard]] Status open_journal();
  /// Saves scenes that are not durable for the next daemon, and refuses further writes. Ends the
  /// process when that exceeds its time limit. Logs what is lost.
  void save_scenes();
  /// Logs the limits that fit() lowered.
  void log_fitted(const std::vector<Fitted>& limits);
  /// Begins to record. INVALID_ARGUMENT: the file cannot be created.
  [[nodiscard]] Status open_recorder();
  /// Notes in the recording, if there is one, the revision that a query reads.
  void note_revision(const grpc::ServerContextBase& context, Revision revision) const {
    if (recorder) recorder->revision(&context, revision);
  }
  /// Restores the replies of calls that made a resumed session's scenes, so that it may repeat
  /// them.
  void restore_requests(Session& session);

 private:
  [[nodiscard]] CallLog::Options call_log_options();
  /// Drops uploads that sessions need no more (recent.h), once per second.
  void sweep_uploads();
};

/// Ends the process after so many seconds, with kExitDevice, whatever hangs.
void end_within(u32 seconds);

}  // namespace heliograph::server
