// Whose a call is and when it stops: what Render, RenderBatch and Stream have in common.
#pragma once

#include <functional>
#include <optional>
#include <stop_token>

#include "server/rpc.h"

namespace heliograph::server {

/// Thread: any.
class CallScope {
 public:
  CallScope(grpc::CallbackServerContext& context, Call call)
      : context_(context),
        call_(std::move(call)),
        on_session_end_(call_.session()->ended(), [this] { request_stop(); }) {}
  CallScope(const CallScope&) = delete;
  CallScope& operator=(const CallScope&) = delete;

  [[nodiscard]] grpc::CallbackServerContext& context() const { return context_; }
  [[nodiscard]] const std::shared_ptr<Session>& session() const { return call_.session(); }
  /// When the client gives up.
  [[nodiscard]] std::optional<std::chrono::steady_clock::time_point> deadline() const {
    return deadline_of(context_);
  }
  /// Stops when the client cancels, its deadline passes, or the session ends.
  [[nodiscard]] std::stop_token stop() const { return stop_.get_token(); }
  void request_stop() { stop_.request_stop(); }
  [[nodiscard]] bool is_stopped() const { return stop_.stop_requested(); }

 private:
  grpc::CallbackServerContext& context_;
  Call call_;
  std::stop_source stop_;
  std::stop_callback<std::function<void()>> on_session_end_;
};

}  // namespace heliograph::server
