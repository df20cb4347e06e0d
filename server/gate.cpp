// Admission of calls. See gate.h.
#include "server/gate.h"

#include <charconv>
#include <string_view>

#include "server/token.h"

namespace heliograph::server {
namespace {

constexpr std::string_view kBearer = "Bearer ";

std::string_view metadata(const grpc::CallbackServerContext& context, const char* name) {
  const auto& all = context.client_metadata();
  const auto found = all.find(name);
  return found == all.end() ? std::string_view()
                            : std::string_view(found->second.data(), found->second.size());
}

}  // namespace

Expected<Call> Gate::admit(const grpc::CallbackServerContext& context, Needs needs) {
  HELIO_TRY(check_token(context));
  const bool is_work = needs == Needs::kSession;
  if (is_closed_ && (is_work || needs == Needs::kNewSession)) return shutting_down();
  if (needs == Needs::kNothing || needs == Needs::kNewSession) return Call();
  auto session = find_session(context);
  if (!session) return std::unexpected(session.error());
  HELIO_TRY((*session)->begin_call());
  return Call(std::move(*session), is_work ? active_ : nullptr);
}

Status Gate::check_token(const grpc::CallbackServerContext& context) const {
  if (context.peer().starts_with("unix:")) return {};
  const std::string_view header = metadata(context, "authorization");
  if (!token_.empty() && header.starts_with(kBearer) &&
      same_token(header.substr(kBearer.size()), token_))
    return {};
  return fail(Code::kUnauthenticated, "",
              "over TCP each call carries the daemon's token as metadata 'authorization: Bearer "
              "TOKEN'; read it from the file that --token-file names");
}

Expected<std::shared_ptr<Session>> Gate::find_session(
    const grpc::CallbackServerContext& context) const {
  const std::string_view text = metadata(context, "heliograph-session");
  u64 id = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), id);
  auto session = parsed.ec == std::errc() && parsed.ptr == text.data() + text.size()
                     ? sessions_.find(id)
                     : nullptr;
  if (session) return session;
  return fail(Code::kUnauthenticated, "",
              text.empty() ? "the call carries no session; call OpenSession and send its id as "
                             "metadata 'heliograph-session'"
                           : "the session is not open: it was closed, its connection ended, or the "
                             "daemon restarted; call OpenSession again");
}

}  // namespace heliograph::server
