// What every call passes first: identity, session, limits, drain. Called by rpc.h only.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <memory>
#include <string>

#include "server/os/busy_times.h"
#include "server/session/session.h"

namespace heliograph::server {

/// A call that was let in; counted until it is destroyed. The gate alone makes one, and without one
/// there is no session, and so no scene.
class Call {
 public:
  Call(Call&&) = default;
  Call& operator=(Call&&) = delete;
  ~Call() {
    if (session_ && !is_answered_) session_->end_call();
    if (active_) --*active_;
  }

  /// Who makes it.
  [[nodiscard]] const TenantPtr& tenant() const { return tenant_; }
  /// Never null where the call needs a session; one of the tenant's.
  [[nodiscard]] const std::shared_ptr<Session>& session() const { return session_; }
  /// Charges its request to its tenant until it is destroyed. RESOURCE_EXHAUSTED with a retry time.
  [[nodiscard]] Status charge(u64 request_bytes);
  /// Its answer is about to go, after which the session may make another in its place; at most
  /// once.
  void answered() {
    if (session_) session_->end_call();
    is_answered_ = true;
  }

 private:
  friend class Gate;
  explicit Call(TenantPtr tenant) : tenant_(std::move(tenant)) {}
  Call(std::shared_ptr<Session> session, std::shared_ptr<std::atomic<u32>> active)
      : tenant_(session->tenant()), session_(std::move(session)), active_(std::move(active)) {
    if (active_) ++*active_;
  }

  TenantPtr tenant_;
  std::shared_ptr<Session> session_;
  std::shared_ptr<std::atomic<u32>> active_;
  Charge request_;
  bool is_answered_ = false;
};

/// The names of the certificate at the other end: its subject's alternative names, or its common
/// name where it has none; none without TLS. They live as long as the context.
[[nodiscard]] std::vector<std::string_view> names_of(const grpc::AuthContext& context);
/// The token of an authorization header; "": it has none.
[[nodiscard]] std::string_view token_of(std::string_view header);

/// Who a call says it is from, for later than its context lives.
struct Credentials {
  bool is_local = false;
  std::string token;
  std::vector<std::string> names;

  explicit Credentials(const grpc::CallbackServerContext& context);
  [[nodiscard]] Caller caller() const {
    return {.is_local = is_local, .token = token, .names = {names.begin(), names.end()}};
  }
};

/// What a call needs to be let in.
enum class Needs {
  kNothing,     // but an identity
  kNewSession,  // it opens one: not while the daemon drains
  kSession,
  kSessionAlways,  // also while the daemon drains; not counted as work
};

/// Thread: any.
class Gate {
 public:
  Gate(const Tenants& tenants, Sessions& sessions) : tenants_(tenants), sessions_(sessions) {}

  /// UNAUTHENTICATED (identity, or no session of this tenant), UNAVAILABLE (draining),
  /// RESOURCE_EXHAUSTED (too many calls).
  [[nodiscard]] Expected<Call> admit(const grpc::CallbackServerContext& context, Needs needs);
  /// The same for a call of a session that does not come by gRPC.
  [[nodiscard]] Expected<Call> admit(const Caller& caller, u64 session);

  /// Whether these are of a tenant still: tokens and certificates are withdrawn while calls run.
  /// UNAUTHENTICATED.
  [[nodiscard]] Status check(const Credentials& credentials, const TenantPtr& tenant) const;

  /// From now on new work is refused.
  void close() { is_closed_ = true; }
  [[nodiscard]] bool is_closed() const { return is_closed_; }
  /// Threads of gRPC that begin a call.
  [[nodiscard]] BusyTimes& reactions() { return reactions_; }
  [[nodiscard]] const BusyTimes& reactions() const { return reactions_; }
  /// Calls in flight, without KeepSession.
  [[nodiscard]] u32 active() const { return *active_; }

 private:
  [[nodiscard]] Expected<Call> enter(std::shared_ptr<Session> session, const Tenant& tenant,
                                     bool is_work) const;

  const Tenants& tenants_;
  Sessions& sessions_;
  BusyTimes reactions_;
  std::atomic<bool> is_closed_ = false;
  std::shared_ptr<std::atomic<u32>> active_ = std::make_shared<std::atomic<u32>>(0);
};

}  // namespace heliograph::server
