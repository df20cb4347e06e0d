// Calls that are declared for later versions: each says what is missing.
#include "server/rpc.h"
#include "server/service.h"

namespace heliograph::server {
namespace {

Error missing(const char* call, const char* instead) {
  return {.code = Code::kUnimplemented,
          .message = std::string(call) + " is not part of this version; " + instead,
          .where = ""};
}

}  // namespace

Writer<v1::WatchReply>* Service::Watch(Context* context, const v1::WatchRequest*) {
  using Reactor = Writer<v1::WatchReply>;
  return let_in<Reactor>(daemon_.gate, context, Needs::kSession, [&](const Call&) {
    return new Refusal<Reactor>(*context, missing("Watch", "poll DescribeScene for the revision"));
  });
}

}  // namespace heliograph::server
