// UploadBlob: chunks in order, hashed as they come.
#include "server/rpc.h"
#include "server/service.h"

namespace heliograph::server {
namespace {

class UploadCall final : public Reader<v1::UploadBlobRequest> {
 public:
  UploadCall(grpc::CallbackServerContext& context, Call call, v1::UploadBlobReply& reply,
             u64 chunk_bytes)
      : context_(context), call_(std::move(call)), reply_(reply), chunk_bytes_(chunk_bytes) {
    StartRead(&message_);
  }
  void OnReadDone(bool ok) override {
    if (!ok) return Finish(to_status(end(), context_));
    const Status taken = take();
    if (!taken || reply_.existed()) return Finish(to_status(taken, context_));
    StartRead(&message_);
  }
  void OnDone() override { delete this; }

 private:
  /// Takes one message. Bytes that the daemon has are not read: the call ends at once.
  Status take() {
    HELIO_TRY(check_known(message_));
    if (message_.chunk().size() > chunk_bytes_)
      return fail(Code::kInvalidArgument, "chunk",
                  fmt::format("has {} bytes; send at most {} in a message", message_.chunk().size(),
                              chunk_bytes_));
    const std::string chunk = std::move(*message_.mutable_chunk());
    if (!first_) HELIO_TRY(begin());
    return incoming_ ? incoming_->append(chunk) : Status();
  }
  Status begin() {
    first_ = message_;
    auto incoming = call_.session()->holdings().begin(*first_);
    if (!incoming) return std::unexpected(incoming.error());
    incoming_ = std::move(*incoming);
    reply_.set_size(first_->size());
    reply_.set_existed(!incoming_);
    return {};
  }
  Status end() {
    if (context_.IsCancelled()) return fail(Code::kCancelled, "", "the upload was cancelled");
    if (!first_)
      return fail(Code::kInvalidArgument, "size",
                  "is missing: no message came, or none that can be read; the first one has it");
    return call_.session()->holdings().finish(*first_, std::move(*incoming_));
  }

  grpc::CallbackServerContext& context_;
  Call call_;
  v1::UploadBlobReply& reply_;
  const u64 chunk_bytes_;
  v1::UploadBlobRequest message_;
  std::optional<v1::UploadBlobRequest> first_;  // without its chunk
  std::optional<Incoming> incoming_;
};

}  // namespace

Reader<v1::UploadBlobRequest>* Service::UploadBlob(Context* context, v1::UploadBlobReply* reply) {
  using Reactor = Reader<v1::UploadBlobRequest>;
  return let_in<Reactor>(daemon_.gate, context, Needs::kSession, [&](Call call) {
    return new UploadCall(*context, std::move(call), *reply, daemon_.config.limits.chunk_bytes);
  });
}

}  // namespace heliograph::server
