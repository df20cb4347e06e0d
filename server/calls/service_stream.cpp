// RenderBatch and Stream.
#include "server/calls/batch_call.h"
#include "server/calls/stream_call.h"

namespace heliograph::server {
namespace {

/// Admits a call that counts towards its tenant's streams, and starts it.
template <class Started>
grpc::ServerBidiReactor<typename Started::Request, typename Started::Reply>* admit(
    Daemon& daemon, Context* context) {
  using Reactor = grpc::ServerBidiReactor<typename Started::Request, typename Started::Reply>;
  return let_in<Reactor>(daemon.gate, context, Needs::kSession, [&](Call call) -> Reactor* {
    auto counted = Charge::take(call.tenant()->ledger.streams, 1);
    if (!counted) return new Refusal<Reactor>(*context, counted.error());
    return Started::start(daemon, *context, std::move(call), std::move(*counted));
  });
}

}  // namespace

grpc::ServerBidiReactor<v1::RenderBatchRequest, v1::RenderBatchReply>* Service::RenderBatch(
    Context* context) {
  return admit<BatchCall>(daemon_, context);
}

grpc::ServerBidiReactor<v1::StreamRequest, v1::FramePart>* Service::Stream(Context* context) {
  return admit<StreamCall>(daemon_, context);
}

}  // namespace heliograph::server
