// One client: its calls, its retries, its uploads, and how long it lives.
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
#include "server/store/holdings.h"
#include "server/store/shared_frames.h"

namespace heliograph::server {

/// What a caller is told while the daemon ends.
[[nodiscard]] std::unexpected<Error> shutting_down();

/// Who opens a session.
struct SessionOwner {
  std::string client;  // free text, for logs
  TenantPtr tenant;
  u64 resume = 0;  // the session of before the daemon was restarted; 0: none
};

/// Thread: any. Lives as long as a call of it runs, even after it was closed.
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
        holdings_(tenant_->blobs, tenant_->assets, tenant_->ledger.bytes) {
    holdings_.shared().lend(
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
  /// Stops when the session ends; its jobs stop with it.
  [[nodiscard]] std::stop_token ended() const { return stop_.get_token(); }
  [[nodiscard]] RequestLog& requests() { return requests_; }
  /// Its blobs, uploads and assets.
  [[nodiscard]] Holdings& holdings() { return holdings_; }

  /// Where its frames go; null: they travel as bytes.
  [[nodiscard]] std::shared_ptr<SharedFrames> shared_frames() const {
    return shared_frames_.load();
  }
  /// Its client maps buffers, which `send` hands over. Once.
  void share_frames(SharedFrames::Send send);

  /// RESOURCE_EXHAUSTED when too many calls run. end_call() must follow.
  [[nodiscard]] Status begin_call();
  void end_call() { --calls_; }
  [[nodiscard]] u32 calls() const { return calls_; }
  [[nodiscard]] double open_seconds() const {
    return std::chrono::duration<double>(EventLoop::Clock::now() - opened_).count();
  }
  /// When, in nanoseconds of a clock that only sessions share.
  [[nodiscard]] u64 opened() const { return u64(opened_.time_since_epoch().count()); }
  /// `status`, but a call that was cancelled because the daemon ends is UNAVAILABLE and says so.
  [[nodiscard]] Status told(Status status) const;

 private:
  friend class Sessions;
  [[nodiscard]] Expected<std::shared_ptr<SharedFrames>> lending_frames() const;

  const u64 id_;
  const std::string client_;
  const TenantPtr tenant_;
  const Limits limits_;
  RequestLog requests_;
  Holdings holdings_;
  std::stop_source stop_;
  const EventLoop::Clock::time_point opened_ = EventLoop::Clock::now();
  std::atomic<u32> calls_ = 0;
  std::atomic<std::shared_ptr<SharedFrames>> shared_frames_;
  Charge counted_;                          // while it is open; Sessions' alone
  std::atomic<bool> is_shut_down_ = false;  // the daemon ended it
  u32 carriers_ = 0;  // lifelines and KeepSession streams; guarded by Sessions::mutex_
  u64 losses_ = 0;    // how often the last carrier ended
};

/// CANCELLED when the session ended, UNAVAILABLE when the daemon ended it.
[[nodiscard]] inline Status check_open(const Session& session) {
  if (!session.ended().stop_requested()) return {};
  return session.told(fail(Code::kCancelled, "", "the session ended; open another"));
}

struct EndedSession {
  u64 id = 0;
  std::string client;  // "": it was not resumed
  TenantPtr tenant;
};

/// The open sessions. A session lives while something carries it (its second socket, or a
/// KeepSession stream) and for the grace time after that. Thread: any.
class Sessions {
 public:
  struct Options {
    double grace_seconds = 10;
    Session::Limits session;
  };
  using Ended = std::function<void(const EndedSession&)>;
  /// `ended` is called once for each session, from any thread, after its jobs were told to stop.
  Sessions(EventLoop& loop, Options options, Ended ended)
      : loop_(loop), options_(options), ended_(std::move(ended)) {}

  /// For that long sessions are resumed; then those kept for it that were not are ended.
  /// kept: sessions with edits that survived, and their tenants.
  void resume_for(double seconds, std::map<u64, TenantPtr> kept);
  /// Sessions of the time before that have more than edits: what of them is not open when the grace
  /// time is over is told to `gone`, from the loop, and may be resumed without that.
  void hold(const std::set<u64>& sessions, std::function<void(u64)> gone);
  /// Opens a session that nothing carries yet: its grace time starts. One that is to be resumed may
  /// be open while nothing carries it, because the reply to its opening was lost. NOT_FOUND when it
  /// is nothing that may be resumed, UNAVAILABLE while something carries it.
  [[nodiscard]] Expected<std::shared_ptr<Session>> open(SessionOwner owner);
  /// Null when it is not open.
  [[nodiscard]] std::shared_ptr<Session> find(u64 id) const;
  void attach(u64 id);
  /// The end of a carrier; of the last one starts the grace time.
  void detach(u64 id);
  void close(u64 id);
  /// All of a tenant's.
  void close_of(const Tenant& tenant);
  /// The daemon ends.
  void close_all();
  [[nodiscard]] u32 count() const;
  [[nodiscard]] std::vector<std::shared_ptr<Session>> list() const;

 private:
  /// is_first: of a session that nothing carried so far.
  [[nodiscard]] EventLoop::Clock::duration grace(bool is_first) const;
  void start_grace(u64 id, u64 loss);
  [[nodiscard]] Expected<u64> new_id(const SessionOwner& owner);
  [[nodiscard]] Expected<std::shared_ptr<Session>> take_up(const SessionOwner& owner);
  void end_resuming();

  EventLoop& loop_;
  const Options options_;
  const Ended ended_;
  mutable std::mutex mutex_;
  std::unordered_map<u64, std::shared_ptr<Session>> open_;
  bool is_resuming_ = false;
  std::map<u64, TenantPtr> kept_;  // sessions that may be resumed -> tenants
};

}  // namespace heliograph::server
