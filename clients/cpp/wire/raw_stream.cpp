#include "wire/raw_stream.h"

#include <chrono>
#include <utility>

namespace heliograph::client::wire {

void Cancelling::cancel() {
  const std::lock_guard lock(mutex_);
  is_cancelled_ = true;
  for (grpc::ClientContext* context : contexts_) context->TryCancel();
}

bool Cancelling::is_cancelled() {
  const std::lock_guard lock(mutex_);
  return is_cancelled_;
}

void Cancelling::add(grpc::ClientContext* context) {
  const std::lock_guard lock(mutex_);
  contexts_.insert(context);
  if (is_cancelled_) context->TryCancel();
}

void Cancelling::remove(grpc::ClientContext* context) {
  const std::lock_guard lock(mutex_);
  contexts_.erase(context);
}

RawStream::RawStream(std::shared_ptr<Session> session, const std::string& method,
                     CallOptions options)
    : session_(std::move(session)), cancellation_(std::move(options.cancellation)) {
  session_->prepare(context_);
  if (options.timeout)
    context_.set_deadline(std::chrono::system_clock::now() +
                          std::chrono::milliseconds(std::int64_t(1000 * *options.timeout)));
  context_.set_initial_metadata_corked(true);
  if (cancellation_) cancellation_->state()->add(&context_);
  grpc::GenericStub stub(session_->channel());
  call_ = stub.PrepareCall(&context_, "/heliograph.v1.Renderer/" + method, &queue_);
  call_->StartCall(nullptr);  // corked: it goes out with the first message, and has no event
}

RawStream::~RawStream() {
  if (cancellation_) cancellation_->state()->remove(&context_);
  if (!is_finished_) {
    context_.TryCancel();
    finish();
  }
  queue_.Shutdown();
  void* tag = nullptr;
  for (bool ok = false; queue_.Next(&tag, &ok);) {
  }
}

void RawStream::send(const google::protobuf::Message& message, bool is_last) {
  const grpc::Slice slice(message.SerializeAsString());
  const std::lock_guard lock(mutex_);
  is_closing_ |= is_last;
  outbox_.emplace_back(&slice, 1);
  write_next();
}

void RawStream::finish_sending() {
  const std::lock_guard lock(mutex_);
  is_closing_ = true;
  write_next();
}

void RawStream::write_next() {
  if (is_writing_ || is_closed_) return;
  if (!outbox_.empty()) {
    is_writing_ = true;
    const bool is_last = is_closing_ && outbox_.size() == 1;
    if (is_last)
      call_->WriteLast(outbox_.front(), grpc::WriteOptions(), this);
    else
      call_->Write(outbox_.front(), this);
    is_closed_ = is_last;
    outbox_.pop_front();
  } else if (is_closing_) {
    is_writing_ = is_closed_ = true;
    call_->WritesDone(this);
  }
}

void RawStream::cancel() {
  is_cancelled_ = true;
  context_.TryCancel();
}

bool RawStream::is_cancelled() {
  return is_cancelled_ || (cancellation_ && cancellation_->state()->is_cancelled());
}

bool RawStream::read(grpc::ByteBuffer* out) {
  if (is_finished_) return false;
  call_->Read(out, out);
  if (await(out)) return true;
  const grpc::Status status = finish();
  if (status.error_code() == grpc::CANCELLED && is_cancelled())
    throw ClientError(Code::kCancelled, "the call was cancelled");
  session_->check(status);
  return false;
}

bool RawStream::await(void* wanted) {
  void* tag = nullptr;
  bool ok = false;
  while (queue_.Next(&tag, &ok)) {
    if (tag == wanted) return ok;
    const std::lock_guard lock(mutex_);  // what was being sent is out
    is_writing_ = false;
    write_next();
  }
  return false;
}

grpc::Status RawStream::finish() {
  {
    const std::lock_guard lock(mutex_);
    is_closed_ = true;
  }
  grpc::Status status;
  call_->Finish(&status, &status);
  await(&status);
  is_finished_ = true;
  return status;
}

}  // namespace heliograph::client::wire
