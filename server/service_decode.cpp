// DecodeAsset: see decode_call.h.
#include "server/decode_call.h"

namespace heliograph::server {

Writer<v1::DecodeAssetReply>* Service::DecodeAsset(Context* context,
                                                   const v1::DecodeAssetRequest* request) {
  using Refused = Refusal<Writer<v1::DecodeAssetReply>>;
  auto admitted = daemon_.gate.admit(*context, Needs::kSession);
  if (!admitted) return new Refused(*context, admitted.error());
  if (auto known = check_known(*request); !known) return new Refused(*context, known.error());
  auto* call = new DecodeCall(daemon_, *context, std::move(*admitted), *request);
  call->post(daemon_.pool);
  return call;
}

}  // namespace heliograph::server
