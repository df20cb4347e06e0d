// RenderBatch and Stream.
#include "server/batch_call.h"
#include "server/stream_call.h"

namespace heliograph::server {
namespace {

/// Admits a call that counts among its tenant's streams, and starts it.
template <class Started>
grpc::ServerBidiReactor<typename Started::Request, typename Started::Reply>* admit(
    Daemon& daemon, Context& context) {
  using Refused =
      Refusal<grpc::ServerBidiReactor<typename Started::Request, typename Started::Reply>>;
  auto admitted = daemon.gate.admit(context, Needs::kSession);
  if (!admitted) return new Refused(context, admitted.error());
  auto counted = Charge::take(admitted->session()->tenant()->streams, 1);
  if (!counted) return new Refused(context, counted.error());
  return Started::start(daemon, context, std::move(*admitted), std::move(*counted));
}

}  // namespace

grpc::ServerBidiReactor<v1::RenderBatchRequest, v1::RenderBatchReply>* Service::RenderBatch(
    Context* context) {
  return admit<BatchCall>(daemon_, *context);
}

grpc::ServerBidiReactor<v1::StreamRequest, v1::FramePart>* Service::Stream(Context* context) {
  return admit<StreamCall>(daemon_, *context);
}

}  // namespace heliograph::server
