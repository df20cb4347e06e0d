// Admission of calls. See gate.h.
#include "server/session/gate.h"

#include <charconv>
#include <string_view>

#include "server/quota/credits.h"

namespace heliograph::server {
namespace {

constexpr std::string_view kBearer = "Bearer ";
constexpr const char* kSecurity = "transport_security_type";
constexpr const char* kSession = "heliograph-session";

std::string_view metadata(const grpc::CallbackServerContext& context, const char* name) {
  const auto& all = context.client_metadata();
  const auto found = all.find(name);
  return found == all.end() ? std::string_view()
                            : std::string_view(found->second.data(), found->second.size());
}

/// Returns the caller's identity; its views live as long as the context.
Caller caller_of(const grpc::CallbackServerContext& context) {
  Caller caller{.is_local = context.peer().starts_with("unix:")};
  caller.token = token_of(metadata(context, "authorization"));
  if (!caller.is_local) caller.names = names_of(*context.auth_context());
  return caller;
}

}  // namespace

Status Call::charge(u64 request_bytes) {
  auto taken = Charge::take(tenant_->ledger.bytes, charged(request_bytes));
  if (!taken) {
    taken.error().retry_seconds = kBusySeconds;  // until other requests have ended
    return std::unexpected(std::move(taken).error());
  }
  request_ = std::move(*taken);
  return {};
}

std::vector<std::string_view> names_of(const grpc::AuthContext& context) {
  const auto kinds = context.FindPropertyValues(kSecurity);
  if (kinds.empty() || (kinds.front() != "tls" && kinds.front() != "ssl")) return {};
  std::vector<std::string_view> names;
  for (const grpc::string_ref& name : context.GetPeerIdentity())
    names.emplace_back(name.data(), name.size());
  return names;
}

std::string_view token_of(std::string_view header) {
  return header.starts_with(kBearer) ? header.substr(kBearer.size()) : std::string_view();
}

Credentials::Credentials(const grpc::CallbackServerContext& context) {
  const Caller from = caller_of(context);
  is_local = from.is_local;
  token = from.token;
  names.assign(from.names.begin(), from.names.end());
}

Status Gate::check(const Credentials& credentials, const TenantPtr& tenant) const {
  const auto now = tenants_.of(credentials.caller());
  if (!now) return std::unexpected(now.error());
  if (*now == tenant) return {};
  return fail(Code::kUnauthenticated, "", "the token or certificate is another tenant's now");
}

Expected<Call> Gate::admit(const grpc::CallbackServerContext& context, Needs needs) {
  auto tenant = tenants_.of(caller_of(context));
  if (!tenant) return std::unexpected(std::move(tenant).error());
  const bool is_work = needs == Needs::kSession;
  if (is_closed_ && (is_work || needs == Needs::kNewSession)) return shutting_down();
  if (needs == Needs::kNothing || needs == Needs::kNewSession) return Call(std::move(*tenant));
  const std::string_view text = metadata(context, kSession);
  u64 id = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), id);
  const bool is_number = parsed.ec == std::errc() && parsed.ptr == text.data() + text.size();
  if (text.empty())
    return fail(Code::kUnauthenticated, "",
                "the call carries no session; call OpenSession and send its id as metadata "
                "'heliograph-session'");
  return enter(is_number ? sessions_.find(id) : nullptr, **tenant, is_work);
}

Expected<Call> Gate::admit(const Caller& caller, u64 session) {
  const auto tenant = tenants_.of(caller);
  if (!tenant) return std::unexpected(tenant.error());
  if (is_closed_) return shutting_down();
  return enter(sessions_.find(session), **tenant, true);
}

Expected<Call> Gate::enter(std::shared_ptr<Session> session, const Tenant& tenant,
                           bool is_work) const {
  if (!session || session->tenant().get() != &tenant)
    return fail(Code::kUnauthenticated, "",
                "the session is not open: it was closed, its connection ended, or the daemon "
                "restarted; call OpenSession again");
  HELIO_TRY(session->begin_call());
  return Call(std::move(session), is_work ? active_ : nullptr);
}

}  // namespace heliograph::server
