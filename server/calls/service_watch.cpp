// Watch.
#include "server/calls/watch_call.h"

namespace heliograph::server {

Writer<v1::WatchReply>* Service::Watch(Context* context, const v1::WatchRequest* request) {
  using Reactor = Writer<v1::WatchReply>;
  return let_in<Reactor>(
      daemon_.gate, context, *request, Needs::kSession, [&](Call call) -> Reactor* {
        auto order = to_order(daemon_, *call.session(), *request);
        if (!order) return new Refusal<Reactor>(*context, order.error());
        return WatchCall::start(daemon_, *context, std::move(call), std::move(*order));
      });
}

}  // namespace heliograph::server
