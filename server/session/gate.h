// Admission of every call: identity, session, limits, drain. Called by rpc.h and quick_calls.cpp.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <memory>
#include <string>

#include "server/os/busy_times.h"
#include "server/session/session.h"

namespace heliograph::server {

/// An admitted call, counted until it is destroyed. Only the gate makes one, and a session, and so
/// a scene, is reached only through one.
class Call {
 public:
  Call(Call&&) = default;
  Call& operator=(Call&&) = delete;
  ~Call() {
    if (session_ && !is_slot_released_) session_->end_call();
    if (active_) --*active_;
  }

  /// Returns the tenant that makes the call.
  [[nodiscard]] const TenantPtr& tenant() const { return tenant_; }
  /// Returns the session, one of the tenant's; null only where the call needs none.
  [[nodiscard]] const std::shared_ptr<Session>& session() const { return session_; }
  /// Charges the request's bytes to the tenant until the call is destroyed. RESOURCE_EXHAUSTED with
  /// a retry time.
  [[nodiscard]] Status charge(u64 request_bytes);
  /// Frees the session's slot of this call, as its reply is about to be sent: the client may make
  /// its next call before this one is destroyed. At most once.
  void release_slot() {
    if (session_) session_->end_call();
    is_slot_released_ = true;
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
  bool is_slot_released_ = false;
};

/// Returns the names of the peer's certificate: its subject alternative names, or its common name
/// where it has none; none without TLS. The views live as long as the context.
[[nodiscard]] std::vector<std::string_view> names_of(const grpc::AuthContext& context);
/// Returns the token of an authorization header; "": it has none.
[[nodiscard]] std::string_view token_of(std::string_view header);

/// Identity of a call's maker, copied so that it outlives the call's context.
struct Credentials {
  bool is_local = false;
  std::string token;
  std::vector<std::string> names;

  explicit Credentials(const grpc::CallbackServerContext& context);
  [[nodiscard]] Caller caller() const {
    return {.is_local = is_local, .token = token, .names = {names.begin(), names.end()}};
  }
};

/// Requirements of a call to be admitted.
enum class Needs {
  kNothing,     // an identity only
  kNewSession,  // opens a session: refused while the daemon drains
  kSession,
  kSessionEvenDraining,  // admitted while the daemon drains too; not counted in active()
};

/// Admits calls. Thread: any.
class Gate {
 public:
  Gate(const Tenants& tenants, Sessions& sessions) : tenants_(tenants), sessions_(sessions) {}

  /// Admits a call that came by gRPC. UNAUTHENTICATED (identity, or no session of this tenant),
  /// UNAVAILABLE (draining), RESOURCE_EXHAUSTED (too many calls).
  [[nodiscard]] Expected<Call> admit(const grpc::CallbackServerContext& context, Needs needs);
  /// Admits a call of a session that did not come by gRPC. Errors as above.
  [[nodiscard]] Expected<Call> admit(const Caller& caller, u64 session);

  /// Checks that credentials still belong to a tenant: tokens and certificates are withdrawn while
  /// calls run. UNAUTHENTICATED.
  [[nodiscard]] Status check(const Credentials& credentials, const TenantPtr& tenant) const;

  /// Refuses new work from now on.
  void close() { is_closed_ = true; }
  [[nodiscard]] bool is_closed() const { return is_closed_; }
  /// Returns the start times of calls that a gRPC thread is beginning.
  [[nodiscard]] BusyTimes& reactions() { return reactions_; }
  [[nodiscard]] const BusyTimes& reactions() const { return reactions_; }
  /// Returns the number of calls in flight, without kSessionEvenDraining.
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
