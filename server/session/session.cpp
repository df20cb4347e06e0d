// Opening, attaching to and ending sessions. Called by the gate, OpenSession and the local channel.
#include "server/session/session.h"

#include <fmt/format.h>
#include <sys/random.h>

namespace heliograph::server {
namespace {

constexpr double kFirstAttachmentSeconds = 5;  // between OpenSession and KeepSession
constexpr double kRestartSeconds = 1;          // until another daemon may be there
constexpr double kHangUpSeconds = 0.1;         // until a hang-up is noticed

std::unexpected<Error> not_resumed() {
  return fail(Code::kNotFound, "resume",
              "the daemon keeps nothing of this session; open a new one, and read what became of "
              "the last edits");
}

std::unexpected<Error> still_attached() {
  return std::unexpected(Error{.code = Code::kUnavailable,
                               .message = "this session is open and something carries it; use it, "
                                          "or retry when that connection has ended",
                               .where = "resume",
                               .retry_seconds = kHangUpSeconds});
}

}  // namespace

std::unexpected<Error> shutting_down() {
  return std::unexpected(
      Error{.code = Code::kUnavailable,
            .message = "this daemon is shutting down; connect to another, or retry when it is back",
            .where = "",
            .reason = "SHUTTING_DOWN",
            .retry_seconds = kRestartSeconds});
}

Status Session::with_shutdown_reason(Status status) const {
  if (!status && status.error().code == Code::kCancelled && is_shut_down_) return shutting_down();
  return status;
}

Status Session::begin_call() {
  if (++calls_ <= limits_.calls) return {};
  --calls_;
  Error error{.code = Code::kResourceExhausted,
              .message = fmt::format("{} calls of this session run already; wait for some of them "
                                     "(limit calls_per_session)",
                                     limits_.calls),
              .where = ""};
  error.retry_seconds = kBusySeconds;
  error.limit = "calls_per_session";
  error.needed = limits_.calls + 1;
  error.available = limits_.calls;
  return std::unexpected(std::move(error));
}

Expected<std::shared_ptr<SharedFrames>> Session::lending_frames() const {
  if (auto frames = shared_frames()) return frames;
  return fail(Code::kNotFound, "buffer.generation",
              "this session maps no buffers, so it was lent none; leave the generation out");
}

void Session::share_frames(SharedFrames::Send send, SharedFrames::Poll poll) {
  if (!shared_frames_.load())
    shared_frames_ = std::make_shared<SharedFrames>(
        SharedRoom::Limits{.bytes = limits_.shared_bytes,
                           .budget = tenant_->ledger.bytes,
                           .descriptors = tenant_->ledger.descriptors},
        std::move(send), std::move(poll));
}

void Sessions::resume_for(double seconds, std::map<u64, TenantPtr> kept) {
  {
    const std::lock_guard lock(mutex_);
    is_resuming_ = true;
    kept_ = std::move(kept);
  }
  const auto delay = std::chrono::duration_cast<EventLoop::Clock::duration>(
      std::chrono::duration<double>(seconds));
  loop_.after(delay, [this] { end_resuming(); });
}

void Sessions::hold(const std::set<u64>& sessions, std::function<void(u64)> gone) {
  if (sessions.empty()) return;
  loop_.after(grace(true), [this, sessions, gone = std::move(gone)] {
    for (const u64 id : sessions)
      if (!find(id)) gone(id);
  });
}

EventLoop::Clock::duration Sessions::grace(bool is_first) const {
  const double seconds =
      is_first ? std::max(kFirstAttachmentSeconds, options_.grace_seconds) : options_.grace_seconds;
  return std::chrono::duration_cast<EventLoop::Clock::duration>(
      std::chrono::duration<double>(seconds));
}

void Sessions::end_resuming() {
  std::map<u64, TenantPtr> lost;
  {
    const std::lock_guard lock(mutex_);
    is_resuming_ = false;
    lost.swap(kept_);
  }
  for (const auto& [id, tenant] : lost) ended_({.id = id, .client = "", .tenant = tenant});
}

Expected<u64> Sessions::new_id(const SessionOwner& owner) {
  u64 id = 0;
  if (owner.resume == 0) {
    while (id == 0)
      if (::getrandom(&id, sizeof id, 0) != sizeof id)
        return fail(Code::kInternal, "", "no random numbers");
    return id;
  }
  const std::lock_guard lock(mutex_);
  const auto kept = kept_.find(owner.resume);
  const bool is_another = kept != kept_.end() && kept->second != owner.tenant;
  if (!is_resuming_ || is_another) return not_resumed();
  if (kept != kept_.end()) kept_.erase(kept);
  return owner.resume;
}

Expected<std::shared_ptr<Session>> Sessions::take_up(const SessionOwner& owner) {
  std::shared_ptr<Session> session;
  u64 epoch = 0;
  {
    const std::lock_guard lock(mutex_);
    const auto found = open_.find(owner.resume);
    if (found == open_.end() || found->second->tenant() != owner.tenant) return not_resumed();
    session = found->second;
    if (session->attachments_ > 0) return still_attached();
    epoch = ++session->detach_epoch_;
  }
  start_grace(owner.resume, epoch);
  return session;
}

Expected<std::shared_ptr<Session>> Sessions::open(SessionOwner owner) {
  if (find(owner.resume)) return take_up(owner);
  HELIO_TRY(owner.tenant->ledger.bytes->admit(Work::kSessions));
  auto counted = Charge::take(owner.tenant->ledger.sessions, 1);
  if (!counted) return std::unexpected(std::move(counted).error());
  const auto made = new_id(owner);
  if (!made) return std::unexpected(made.error());
  const u64 id = *made;
  auto session = std::make_shared<Session>(id, std::move(owner), options_.session);
  session->counted_ = std::move(*counted);
  {
    const std::lock_guard lock(mutex_);
    if (!open_.emplace(id, session).second)
      return still_attached();  // resumed by another call meanwhile
  }
  start_grace(id, 0);
  return session;
}

std::shared_ptr<Session> Sessions::find(u64 id) const {
  const std::lock_guard lock(mutex_);
  const auto found = open_.find(id);
  return found == open_.end() ? nullptr : found->second;
}

void Sessions::attach(u64 id) {
  const std::lock_guard lock(mutex_);
  if (const auto found = open_.find(id); found != open_.end()) ++found->second->attachments_;
}

void Sessions::detach(u64 id) {
  u64 epoch = 0;
  {
    const std::lock_guard lock(mutex_);
    const auto found = open_.find(id);
    if (found == open_.end() || --found->second->attachments_ > 0) return;
    epoch = ++found->second->detach_epoch_;
  }
  start_grace(id, epoch);
}

void Sessions::start_grace(u64 id, u64 epoch) {
  loop_.post([this, id, epoch, delay = grace(epoch == 0)] {
    loop_.after(delay, [this, id, epoch] {
      const auto session = find(id);
      if (!session) return;
      bool is_over;
      {
        const std::lock_guard lock(mutex_);
        is_over = session->attachments_ == 0 && session->detach_epoch_ == epoch;
      }
      if (is_over) close(id);
    });
  });
}

void Sessions::close(u64 id) {
  std::shared_ptr<Session> session;
  {
    const std::lock_guard lock(mutex_);
    const auto found = open_.find(id);
    if (found == open_.end()) return;
    session = std::move(found->second);
    open_.erase(found);
  }
  session->stop_.request_stop();
  session->counted_ = Charge();
  ended_({.id = id, .client = session->client(), .tenant = session->tenant()});
}

void Sessions::close_of(const Tenant& tenant) {
  for (const auto& session : list())
    if (session->tenant().get() == &tenant) close(session->id());
}

void Sessions::close_all() {
  while (true) {
    u64 id;
    {
      const std::lock_guard lock(mutex_);
      if (open_.empty()) return;
      id = open_.begin()->first;
      open_.begin()->second->is_shut_down_ = true;
    }
    close(id);
  }
}

std::vector<std::shared_ptr<Session>> Sessions::list() const {
  std::vector<std::shared_ptr<Session>> all;
  const std::lock_guard lock(mutex_);
  for (const auto& [id, session] : open_) all.push_back(session);
  return all;
}

u32 Sessions::count() const {
  const std::lock_guard lock(mutex_);
  return u32(open_.size());
}

}  // namespace heliograph::server
