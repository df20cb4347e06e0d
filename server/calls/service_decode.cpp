// DecodeAsset: see decode_call.h.
#include "server/calls/decode_call.h"

namespace heliograph::server {

Writer<v1::DecodeAssetReply>* Service::DecodeAsset(Context* context,
                                                   const v1::DecodeAssetRequest* request) {
  using Reactor = Writer<v1::DecodeAssetReply>;
  return let_in<Reactor>(daemon_.gate, context, *request, Needs::kSession, [&](Call admitted) {
    auto* call = new DecodeCall(daemon_, *context, std::move(admitted), *request);
    call->post(daemon_.pool);
    return call;
  });
}

}  // namespace heliograph::server
