// What every call passes first: token, session, known fields, limits, drain. Called by rpc.h only.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <memory>
#include <string>

#include "server/session.h"

namespace heliograph::server {

/// A call that was let in; counted until it is destroyed.
class Call {
 public:
  Call() = default;
  Call(std::shared_ptr<Session> session, std::shared_ptr<std::atomic<u32>> active)
      : session_(std::move(session)), active_(std::move(active)) {
    if (active_) ++*active_;
  }
  Call(Call&&) = default;
  Call& operator=(Call&&) = delete;
  ~Call() {
    if (session_) session_->end_call();
    if (active_) --*active_;
  }

  /// Never null where the call needs a session.
  [[nodiscard]] const std::shared_ptr<Session>& session() const { return session_; }

 private:
  std::shared_ptr<Session> session_;
  std::shared_ptr<std::atomic<u32>> active_;
};

/// What a call needs to be let in.
enum class Needs {
  kNothing,     // but the token over TCP
  kNewSession,  // it opens one: not while the daemon drains
  kSession,
  kSessionAlways,  // also while the daemon drains; not counted as work
};

/// Thread: any.
class Gate {
 public:
  Gate(Sessions& sessions, std::string token) : sessions_(sessions), token_(std::move(token)) {}

  /// UNAUTHENTICATED (token, session), UNAVAILABLE (draining), RESOURCE_EXHAUSTED (too many calls).
  [[nodiscard]] Expected<Call> admit(const grpc::CallbackServerContext& context, Needs needs);

  /// From now on new work is refused.
  void close() { is_closed_ = true; }
  [[nodiscard]] bool is_closed() const { return is_closed_; }
  /// Calls in flight, without KeepSession.
  [[nodiscard]] u32 active() const { return *active_; }

 private:
  [[nodiscard]] Status check_token(const grpc::CallbackServerContext& context) const;
  [[nodiscard]] Expected<std::shared_ptr<Session>> find_session(
      const grpc::CallbackServerContext& context) const;

  Sessions& sessions_;
  const std::string token_;
  std::atomic<bool> is_closed_ = false;
  std::shared_ptr<std::atomic<u32>> active_ = std::make_shared<std::atomic<u32>>(0);
};

}  // namespace heliograph::server
