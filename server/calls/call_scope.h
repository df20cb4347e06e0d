// Owner and stop conditions of a call: common parts of Render, RenderBatch, Stream and the like.
#pragma once

#include <functional>
#include <optional>
#include <stop_token>

#include "server/calls/rpc.h"

namespace heliograph::server {

/// The scope of one call. Thread: any.
class CallScope {
 public:
  CallScope(grpc::CallbackServerContext& context, Call call)
      : context_(context),
        credentials_(context),
        call_(std::move(call)),
        on_session_end_(call_.session()->ended(), [this] { request_stop(); }) {}
  CallScope(const CallScope&) = delete;
  CallScope& operator=(const CallScope&) = delete;

  [[nodiscard]] grpc::CallbackServerContext& context() const { return context_; }
  [[nodiscard]] const std::shared_ptr<Session>& session() const { return call_.session(); }
  /// As Call::charge(), for the request being handled.
  [[nodiscard]] Status charge(u64 request_bytes) { return call_.charge(request_bytes); }
  /// Returns the client's deadline.
  [[nodiscard]] std::optional<std::chrono::steady_clock::time_point> deadline() const {
    return deadline_of(context_);
  }
  /// Returns a token that stops when the client cancels, its deadline passes, or the session ends.
  [[nodiscard]] std::stop_token stop() const { return stop_.get_token(); }
  void request_stop() { stop_.request_stop(); }
  /// As Gate::check(). Does not touch the context, which may be freed while the stall monitor
  /// ticks.
  [[nodiscard]] Status check_identity(const Gate& gate) const {
    return gate.check(credentials_, session()->tenant());
  }
  /// Checks that an endless call may go on: UNAVAILABLE while draining, CANCELLED after the
  /// session's end, UNAUTHENTICATED once its identity was withdrawn.
  [[nodiscard]] Status check_may_continue(const Gate& gate) const {
    if (gate.is_closed()) return shutting_down();
    HELIO_TRY(check_identity(gate));
    return check_open(*session());
  }
  [[nodiscard]] bool is_stopped() const { return stop_.stop_requested(); }

 private:
  grpc::CallbackServerContext& context_;
  const Credentials credentials_;
  Call call_;
  std::stop_source stop_;
  std::stop_callback<std::function<void()>> on_session_end_;
};

}  // namespace heliograph::server
