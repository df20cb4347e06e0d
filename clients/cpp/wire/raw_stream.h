// A call whose replies stay bytes: Render, RenderBatch, Stream. Used by the receivers of frames.
#pragma once

#include <grpcpp/generic/generic_stub.h>

#include <atomic>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>

#include "heliograph/render.h"
#include "wire/session.h"

namespace heliograph::client::wire {

/// Ends calls from any thread.
class Cancelling {
 public:
  void cancel();
  [[nodiscard]] bool is_cancelled();
  void add(grpc::ClientContext* context);
  void remove(grpc::ClientContext* context);

 private:
  std::mutex mutex_;
  bool is_cancelled_ = false;
  std::set<grpc::ClientContext*> contexts_;
};

/// Limits of a call: its timeout, and the Cancellation that may end it.
struct CallOptions {
  std::optional<double> timeout{};  // seconds
  std::optional<Cancellation> cancellation{};
};

/// A stream of messages and a stream of serialised replies. Cancelled when it is left early.
/// Thread: one reads; any sends and cancels. A message sent while another is on its way goes out
/// with the next read.
class RawStream {
 public:
  /// `method`: "Render".
  RawStream(std::shared_ptr<Session> session, const std::string& method, CallOptions options);
  ~RawStream();
  RawStream(const RawStream&) = delete;
  RawStream& operator=(const RawStream&) = delete;

  void send(const google::protobuf::Message& message, bool is_last = false);
  /// Declares that no message follows.
  void finish_sending();
  void cancel();
  /// The next reply; false at the end, which throws unless it is a good one.
  bool read(grpc::ByteBuffer* out);

 private:
  bool await(void* wanted);
  void write_next();  // mutex_ is held
  grpc::Status finish();
  bool is_cancelled();

  const std::shared_ptr<Session> session_;
  const std::optional<Cancellation> cancellation_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call_;
  bool is_finished_ = false;  // the reader's
  std::atomic<bool> is_cancelled_ = false;
  std::mutex mutex_;
  std::deque<grpc::ByteBuffer> outbox_;
  bool is_writing_ = false;
  bool is_closing_ = false;  // finish_sending() was called
  bool is_closed_ = false;   // the daemon knows, or the call ended
};

}  // namespace heliograph::client::wire
