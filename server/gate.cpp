// Admission of calls. See gate.h.
#include "server/gate.h"

#include <charconv>
#include <string_view>
namespace heliograph::server {
namespace {

constexpr std::string_view kBearer = "Bearer ";

std::string_view metadata(const grpc::CallbackServerContext& context, const char* name) {
  const auto& all = context.client_metadata();
  const auto found = all.find(name);
  return found == all.end() ? std::string_view()
                            : std::string_view(found->second.data(), found->second.size());
}

/// The views live as long as the context. Of a certificate: its subject's alternative names, or its
/// common name where it has none.
Caller caller_of(const grpc::CallbackServerContext& context) {
  Caller caller{.is_local = context.peer().starts_with("unix:")};
  const std::string_view header = metadata(context, "authorization");
  if (header.starts_with(kBearer)) caller.token = header.substr(kBearer.size());
  if (caller.is_local) return caller;
  for (const grpc::string_ref& name : context.auth_context()->GetPeerIdentity())
    caller.names.emplace_back(name.data(), name.size());
  return caller;
}

}  // namespace

Expected<Call> Gate::admit(const grpc::CallbackServerContext& context, Needs needs) {
  auto tenant = tenants_.of(caller_of(context));
  if (!tenant) return std::unexpected(std::move(tenant).error());
  const bool is_work = needs == Needs::kSession;
  if (is_closed_ && (is_work || needs == Needs::kNewSession)) return shutting_down();
  if (needs == Needs::kNothing || needs == Needs::kNewSession) return Call(std::move(*tenant));
  auto session = find_session(context, **tenant);
  if (!session) return std::unexpected(session.error());
  HELIO_TRY((*session)->begin_call());
  return Call(std::move(*session), is_work ? active_ : nullptr);
}

Expected<std::shared_ptr<Session>> Gate::find_session(const grpc::CallbackServerContext& context,
                                                      const Tenant& tenant) const {
  const std::string_view text = metadata(context, "heliograph-session");
  u64 id = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), id);
  auto session = parsed.ec == std::errc() && parsed.ptr == text.data() + text.size()
                     ? sessions_.find(id)
                     : nullptr;
  if (session && session->tenant().get() == &tenant) return session;
  return fail(Code::kUnauthenticated, "",
              text.empty() ? "the call carries no session; call OpenSession and send its id as "
                             "metadata 'heliograph-session'"
                           : "the session is not open: it was closed, its connection ended, or the "
                             "daemon restarted; call OpenSession again");
}

}  // namespace heliograph::server
