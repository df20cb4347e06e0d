// A session: one client's calls, retries, uploads and lifetime.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <stop_token>
#include <string>
#include <unordered_map>
#include <vector>

#include "server/access/tenant.h"
#include "server/os/event_loop.h"
#include "server/session/request_log.h"
#include "server/store/session_arrays.h"
#include "server/store/shared_frames.h"

namespace heliograph::server {

/// Returns UNAVAILABLE, reason SHUTTING_DOWN, with a retry time.
[[nodiscard]] std::unexpected<Error> shutting_down();

/// Opener of a session.
struct SessionOwner {
  std::string client;  // free text, for logs
  TenantPtr tenant;
  u64 resume = 0;  // session of the daemon before its restart; 0: none
};

/// One session. Lives as long as any call of it, even after it was closed. Thread: any.
class Session {
 public:
  struct Limits {
    u32 calls = 64;
    u64 shared_bytes = 1ull << 30;
    ReplyLimits replies;
  };
  Session(u64 id, SessionOwner owner, Limits limits)
      : id_(id),
        client_(std::move(owner.client)),
        tenant_(std::move(owner.tenant)),
        limits_(limits),
        requests_(limits.replies, Charge::none(tenant_->ledger.bytes)),
        arrays_(tenant_->blobs, tenant_->assets, tenant_->ledger.bytes) {
    arrays_.shared().lend(
        {.copy = [this](const v1::BufferRef& ref) -> Expected<BufferPtr> {
           const auto frames = lending_frames();
           if (!frames) return std::unexpected(frames.error());
           return (*frames)->copy(ref);
         },
         .read = [this](const v1::BufferRef& ref, const TakePiece& take) -> Status {
           const auto frames = lending_frames();
           if (!frames) return std::unexpected(frames.error());
           return (*frames)->read(ref, take);
         },
         .take = [this](const v1::BufferRef& ref, Numbers kind) -> Expected<BufferPtr> {
           const auto frames = lending_frames();
           if (!frames) return std::unexpected(frames.error());
           return (*frames)->take(ref, kind);
         }});
  }

  [[nodiscard]] u64 id() const { return id_; }
  [[nodiscard]] const std::string& client() const { return client_; }
  [[nodiscard]] const TenantPtr& tenant() const { return tenant_; }
  /// Returns a token that stops when the session ends, and its jobs with it.
  [[nodiscard]] std::stop_token ended() const { return stop_.get_token(); }
  [[nodiscard]] RequestLog& requests() { return requests_; }
  /// Returns its blobs, uploads and assets.
  [[nodiscard]] SessionArrays& arrays() { return arrays_; }

  /// Returns the shared buffers of its frames; null: frames travel as bytes.
  [[nodiscard]] std::shared_ptr<SharedFrames> shared_frames() const {
    return shared_frames_.load();
  }
  /// Begins to share frames: the client maps buffers, which `send` announces, and returns them in
  /// messages, which `poll` delivers. Later calls have no effect.
  void share_frames(SharedFrames::Send send, SharedFrames::Poll poll);

  /// Takes a slot for a call; end_call() must follow. RESOURCE_EXHAUSTED when all are taken.
  [[nodiscard]] Status begin_call();
  void end_call() { --calls_; }
  [[nodiscard]] u32 calls() const { return calls_; }
  [[nodiscard]] double open_seconds() const {
    return std::chrono::duration<double>(EventLoop::Clock::now() - opened_).count();
  }
  /// Returns when it was opened, in nanoseconds of an arbitrary clock: for comparison among
  /// sessions.
  [[nodiscard]] u64 opened() const { return u64(opened_.time_since_epoch().count()); }
  /// Returns `status`, or shutting_down() for a call that was cancelled because the daemon ends.
  [[nodiscard]] Status with_shutdown_reason(Status status) const;

 private:
  friend class Sessions;
  [[nodiscard]] Expected<std::shared_ptr<SharedFrames>> lending_frames() const;

  const u64 id_;
  const std::string client_;
  const TenantPtr tenant_;
  const Limits limits_;
  RequestLog requests_;
  SessionArrays arrays_;
  std::stop_source stop_;
  const EventLoop::Clock::time_point opened_ = EventLoop::Clock::now();
  std::atomic<u32> calls_ = 0;
  std::atomic<std::shared_ptr<SharedFrames>> shared_frames_;
  Charge counted_;                          // held while it is open; accessed by Sessions only
  std::atomic<bool> is_shut_down_ = false;  // the daemon ended it
  u32 attachments_ = 0;   // local channel and KeepSession streams; guarded by Sessions::mutex_
  u64 detach_epoch_ = 0;  // counts last detachments; voids older grace timers
};

/// Checks that a session is open. CANCELLED when it ended, UNAVAILABLE when the daemon ended it.
[[nodiscard]] inline Status check_open(const Session& session) {
  if (!session.ended().stop_requested()) return {};
  return session.with_shutdown_reason(
      fail(Code::kCancelled, "", "the session ended; open another"));
}

struct EndedSession {
  u64 id = 0;
  std::string client;  // "": kept for resumption, never resumed
  TenantPtr tenant;
};

/// The open sessions. A session lives while a connection is attached (its local channel, or a
/// KeepSession stream) and for the grace time after that. Thread: any.
class Sessions {
 public:
  struct Options {
    double grace_seconds = 10;
    Session::Limits session;
  };
  using Ended = std::function<void(const EndedSession&)>;
  /// ended   called once per session, from any thread, after its jobs were asked to stop
  Sessions(EventLoop& loop, Options options, Ended ended)
      : loop_(loop), options_(options), ended_(std::move(ended)) {}

  /// Lets clients resume sessions for so many seconds; then ends the kept ones that were not
  /// resumed. kept: sessions with edits that survived, and their tenants.
  void resume_for(double seconds, std::map<u64, TenantPtr> kept);
  /// Keeps sessions of the daemon before the restart that own more than edits. After the grace time
  /// calls `gone`, from the loop, for each that is not open; it may be resumed later, without what
  /// it owned.
  void hold(const std::set<u64>& sessions, std::function<void(u64)> gone);
  /// Opens a session without an attachment: its grace time starts. A session to be resumed may be
  /// open already, when the reply to its opening was lost. NOT_FOUND when it may not be resumed,
  /// UNAVAILABLE while a connection is attached.
  [[nodiscard]] Expected<std::shared_ptr<Session>> open(SessionOwner owner);
  /// Returns a session; null when it is not open.
  [[nodiscard]] std::shared_ptr<Session> find(u64 id) const;
  void attach(u64 id);
  /// Ends an attachment; the last one starts the grace time.
  void detach(u64 id);
  void close(u64 id);
  /// Closes all sessions of a tenant.
  void close_of(const Tenant& tenant);
  /// Closes all sessions, because the daemon ends.
  void close_all();
  [[nodiscard]] u32 count() const;
  [[nodiscard]] std::vector<std::shared_ptr<Session>> list() const;

 private:
  /// is_first: nothing was attached so far.
  [[nodiscard]] EventLoop::Clock::duration grace(bool is_first) const;
  void start_grace(u64 id, u64 epoch);
  [[nodiscard]] Expected<u64> new_id(const SessionOwner& owner);
  [[nodiscard]] Expected<std::shared_ptr<Session>> take_up(const SessionOwner& owner);
  void end_resuming();

  EventLoop& loop_;
  const Options options_;
  const Ended ended_;
  mutable std::mutex mutex_;
  std::unordered_map<u64, std::shared_ptr<Session>> open_;
  bool is_resuming_ = false;
  std::map<u64, TenantPtr> kept_;  // session that may be resumed -> tenant
};

}  // namespace heliograph::server
