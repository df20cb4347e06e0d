// UploadBlob: chunks in order, hashed as they arrive. LendBuffer: device memory for a client's
// arrays.
#include "server/calls/monitored_reader.h"
#include "server/calls/rpc.h"
#include "server/calls/service.h"

namespace heliograph::server {
namespace {

class UploadCall final : public MonitoredReader<v1::UploadBlobRequest> {
 public:
  UploadCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call,
             v1::UploadBlobReply& reply)
      : MonitoredReader(daemon, context),
        call_(std::move(call)),
        reply_(reply),
        chunk_bytes_(daemon.config.limits.chunk_bytes) {}

 private:
  void came(bool ok) override {
    if (!ok) return finish(end());
    const Status taken = take();
    if (!taken || reply_.existed()) return finish(taken);
    read();
  }
  void let_go() override { incoming_.reset(); }

  /// Handles one message. For bytes that the daemon has already, the call ends at once.
  Status take() {
    HELIO_TRY(check_known(message()));
    if (message().chunk().size() > chunk_bytes_)
      return fail(Code::kInvalidArgument, "chunk",
                  fmt::format("has {} bytes; send at most {} in a message",
                              message().chunk().size(), chunk_bytes_));
    const std::string chunk = std::move(*message().mutable_chunk());
    if (!first_) HELIO_TRY(begin());
    return incoming_ ? incoming_->append(chunk) : Status();
  }
  Status begin() {
    first_ = message();
    auto incoming = call_.session()->arrays().begin(*first_);
    if (!incoming) return std::unexpected(incoming.error());
    incoming_ = std::move(*incoming);
    reply_.set_size(first_->size());
    reply_.set_existed(!incoming_);
    return {};
  }
  Status end() {
    if (context().IsCancelled()) return fail(Code::kCancelled, "", "the upload was cancelled");
    if (!first_)
      return fail(Code::kInvalidArgument, "size",
                  "is missing: no message came, or none that can be read; the first one has it");
    return call_.session()->arrays().finish(*first_, std::move(*incoming_));
  }

  Call call_;
  v1::UploadBlobReply& reply_;
  const u64 chunk_bytes_;
  std::optional<v1::UploadBlobRequest> first_;  // without its chunk
  std::optional<Incoming> incoming_;
};

Expected<Lease> lend(Daemon& daemon, const Session& session, u64 size) {
  const auto engine = daemon.engine->wait();
  if (!engine) return std::unexpected(engine.error());
  const auto source = (*engine)->shared_memory();
  const auto frames = session.shared_frames();
  if (!source || !frames)
    return fail(Code::kFailedPrecondition, "",
                source ? "this session maps no buffers; connect over the daemon's Unix socket"
                       : "this daemon has no memory of a GPU to share; start it with --backend "
                         "cuda, or send the array from the host");
  if (daemon.recorder)
    return fail(Code::kFailedPrecondition, "",
                "this daemon records, and what is written on the GPU it does not see; send the "
                "array from the host, or start it without --record");
  if (size == 0) return fail(Code::kInvalidArgument, "size", "is 0; say how many bytes");
  auto lease = frames->lease(size, frames->new_call(), source);
  if (lease) return *std::move(lease);
  return fail(Code::kResourceExhausted, "size",
              fmt::format("there is no device memory for {} bytes; let go of frames and buffers "
                          "that you hold (limits shared_bytes, tenant_bytes)",
                          size));
}

}  // namespace

grpc::ServerUnaryReactor* Service::LendBuffer(Context* context,
                                              const v1::LendBufferRequest* request,
                                              v1::BufferRef* reply) {
  return unary(daemon_.gate, context, *request, Needs::kSession, [&](UnaryCall& call) {
    call.post(daemon_.pool, [this, request, reply, &call] {
      const auto lease = lend(daemon_, *call.session(), request->size());
      if (!lease) return call.finish(std::unexpected(lease.error()));
      reply->set_buffer(lease->buffer);
      reply->set_size(request->size());
      reply->set_generation(lease->generation);
      call.finish({});
    });
  });
}

Reader<v1::UploadBlobRequest>* Service::UploadBlob(Context* context, v1::UploadBlobReply* reply) {
  using Reactor = Reader<v1::UploadBlobRequest>;
  return let_in<Reactor>(daemon_.gate, context, Needs::kSession, [&](Call call) {
    return UploadCall::start(
        std::make_shared<UploadCall>(daemon_, *context, std::move(call), *reply), daemon_);
  });
}

}  // namespace heliograph::server
