// Events and bookmarks. See watch_call.h.
#include "server/calls/watch_call.h"

#include <cmath>

#include "server/convert/error.h"

namespace heliograph::server {
namespace {

constexpr double kBookmarkSeconds = 10;  // default of the request's field
constexpr double kShortest = 0.5, kLongest = 3600;

}  // namespace

Expected<WatchOrder> to_order(Daemon& daemon, const Session& session,
                              const v1::WatchRequest& request) {
  WatchOrder order{.scene = request.scene(), .events = {}, .counted = {}};
  order.bookmark_seconds =
      request.bookmark_seconds() == 0 ? kBookmarkSeconds : request.bookmark_seconds();
  if (!(order.bookmark_seconds >= kShortest && order.bookmark_seconds <= kLongest))
    return fail(Code::kInvalidArgument, "bookmark_seconds",
                fmt::format("{} is not within [{}, {}]; 0 is {}", request.bookmark_seconds(),
                            kShortest, kLongest, kBookmarkSeconds));
  const auto entry = daemon.scenes.find(request.scene(), session);
  if (!entry) return std::unexpected(entry.error());
  order.events = (*entry)->watched();
  order.next = request.from_revision() == 0 ? order.events->head() + 1 : request.from_revision();
  if (const auto first = order.events->at(order.next); !first)
    return std::unexpected(first.error());
  auto counted = Charge::take(session.tenant()->ledger.streams, 1);
  if (!counted) return std::unexpected(std::move(counted).error());
  order.counted = std::move(*counted);
  return order;
}

WatchCall* WatchCall::start(Daemon& daemon, grpc::CallbackServerContext& context, Call call,
                            WatchOrder order) {
  std::shared_ptr<WatchCall> made(
      new WatchCall(daemon, context, std::move(call), std::move(order)));
  made->self_ = made;
  if (auto followed = made->follow(); !followed) made->result_ = std::move(followed);
  daemon.stall_monitor.add(made);
  made->advance();
  return made.get();
}

WatchCall::WatchCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call,
                     WatchOrder order)
    : daemon_(daemon), scope_(context, std::move(call)), order_(std::move(order)) {}

/// Subscribes to the scene's revisions.
Status WatchCall::follow() {
  const auto entry = daemon_.scenes.find(order_.scene, *scope_.session());
  if (!entry) return std::unexpected(entry.error());
  watch_ = (*entry)->watch([weak = weak_from_this()](Revision) {
    if (const auto call = weak.lock()) call->advance();
  });
  return {};
}

/// Works on the call unless a thread does already, which then looks again.
void WatchCall::advance() {
  {
    const std::lock_guard lock(mutex_);
    is_notified_ = true;
    if (is_busy_) return;
    is_busy_ = true;
  }
  post_work();
}

void WatchCall::post_work() {
  const u64 tenant = scope_.session()->tenant()->id;
  if (!daemon_.pool.post(tenant, [call = shared_from_this()] { call->work(); }))
    work();  // here: a full pool must not lose an event
}

/// Starts the next message, or ends, or waits for a notification. Called by the busy thread.
void WatchCall::work() {
  for (;;) {
    {
      const std::lock_guard lock(mutex_);
      is_notified_ = false;
    }
    if (scope_.is_stopped()) return finish(fail(Code::kCancelled, "", "cancelled by the client"));
    const auto has_message = next_message();
    if (!has_message) return finish(std::unexpected(has_message.error()));
    std::optional<Status> result;
    {
      const std::lock_guard lock(mutex_);
      is_writing_ = *has_message;
      if (is_writing_) standstill_.moved();
      if (!is_writing_ && !is_notified_) {
        if (!result_) {
          is_busy_ = false;
          return;
        }
        result = result_;
      }
    }
    if (*has_message) return StartWrite(&reply_);
    if (result) return finish(*result);
  }
}

/// Fills reply_; false when there is nothing to send now.
Expected<bool> WatchCall::next_message() {
  const auto event = order_.events->at(order_.next);
  if (!event) return std::unexpected(event.error());
  bool is_bookmark = false;
  {
    const std::lock_guard lock(mutex_);
    is_bookmark = std::exchange(is_bookmark_due_, false);
  }
  reply_.Clear();
  if (is_bookmark) {
    reply_.set_revision(order_.next - 1);
    return true;
  }
  if (!*event) return false;
  reply_.ParseFromString(**event);
  ++order_.next;
  return true;
}

/// Finishes the call, which stays busy so that no thread starts anything after it.
void WatchCall::finish(const Status& status) {
  watch_.reset();
  Finish(to_status(scope_.session()->with_shutdown_reason(status), scope_.context()));
}

void WatchCall::OnWriteDone(bool ok) {
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = false;
  }
  if (!ok) scope_.request_stop();
  post_work();
}

void WatchCall::OnCancel() {
  scope_.request_stop();
  advance();
}

void WatchCall::on_tick(EventLoop::Clock::time_point now) {
  Status lasting = scope_.check_may_continue(daemon_.gate);
  if (lasting)
    if (const auto found = daemon_.scenes.find(order_.scene, *scope_.session()); !found)
      lasting = std::unexpected(found.error());
  bool is_stuck = false;
  {
    const std::lock_guard lock(mutex_);
    if (!lasting && !result_) result_ = std::move(lasting);
    is_stuck =
        is_writing_ && standstill_.is_longer_than(double(daemon_.config.limits.stall_seconds), now);
    is_bookmark_due_ |= !is_busy_ && standstill_.is_longer_than(order_.bookmark_seconds, now);
    if (!is_stuck && !is_bookmark_due_ && !result_ && !scope_.is_stopped()) return;
  }
  if (is_stuck) scope_.context().TryCancel();  // only this ends a write in flight
  advance();
}

}  // namespace heliograph::server
