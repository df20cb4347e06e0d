// What is known of a call while it runs, for its line in the log: put together by the call log, the
// gate's callers and the render tasks.
#pragma once

#include <grpcpp/generic/async_generic_service.h>
#include <grpcpp/server_context.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

#include "renderer/schedule/engine.h"
#include "server/os/trace.h"

namespace heliograph::server {

using CallClock = std::chrono::steady_clock;

/// Who sets the pace of a call, and so which limit says that it is slow.
enum class Pace {
  kShort,   // slow_call_seconds
  kRender,  // slow_render_seconds: it waits for the device, or for a decoder
  kClient,  // none: it lasts as long as its client wants, or moves the client's bytes
};

/// The jobs of a call, one after the other or at once.
struct CallJobs {
  u32 count = 0;
  CallClock::time_point first, last;  // when one was queued, and when one was done
  double waited_seconds = 0;          // of all: until a device had them
  double aside_seconds = 0;           // derived data, and planes made of others
  double device_seconds = 0;
};

/// The method of a call that none of the services has: what its caller names it ends before the
/// call does, and would be a series of the metrics for each name.
constexpr std::string_view kUnknownMethod = "/unknown";

struct CallFacts {
  std::string_view method;  // "/heliograph.v1.Renderer/Apply", kUnknownMethod; outlives the call
  CallClock::time_point start;
  std::string request;  // its id
  Trace trace;
  std::string peer;    // as gRPC names it
  std::string tenant;  // "": it was not let in
  std::string client;  // the name that the session's client gave itself
  u64 session = 0;     // 0: none
  u64 scene = 0;       // 0: none
  std::string scene_name;
  Pace pace = Pace::kClient;
  u64 received_bytes = 0, sent_bytes = 0;  // of messages
  CallJobs jobs;
};

/// Thread: any.
class CallRecord {
 public:
  [[nodiscard]] CallFacts facts() const {
    const std::lock_guard lock(mutex_);
    return facts_;
  }
  [[nodiscard]] Trace trace() const {
    const std::lock_guard lock(mutex_);
    return facts_.trace;
  }
  /// Changes the facts.
  template <class Change>
  void note(const Change& change) {
    const std::lock_guard lock(mutex_);
    change(facts_);
  }
  /// A job is queued.
  void begin_job() {
    const std::lock_guard lock(mutex_);
    const auto now = CallClock::now();
    if (facts_.jobs.count++ == 0) facts_.jobs.first = facts_.jobs.last = now;
  }
  /// It is done.
  void end_job(const Spent& spent) {
    const std::lock_guard lock(mutex_);
    CallJobs& jobs = facts_.jobs;
    jobs.last = CallClock::now();
    jobs.waited_seconds += spent.waited_seconds;
    jobs.aside_seconds += spent.aside_seconds;
    jobs.device_seconds += spent.seconds;
  }

 private:
  mutable std::mutex mutex_;
  CallFacts facts_;
};
using CallRecordPtr = std::shared_ptr<CallRecord>;

/// A call's context with its record, which is written to the log after the context is gone.
class RecordedContext final : public grpc::CallbackServerContext {
 public:
  const CallRecordPtr record = std::make_shared<CallRecord>();
};

/// gRPC makes every context of a call here. One of a method that is not known has no record, but is
/// made here too: what gRPC 1.51 makes beside an allocator it ends twice.
class RecordedContexts final : public grpc::ContextAllocator {
 public:
  grpc::CallbackServerContext* NewCallbackServerContext() override { return new RecordedContext; }
  grpc::GenericCallbackServerContext* NewGenericCallbackServerContext() override {
    return new grpc::GenericCallbackServerContext;
  }
  void Release(grpc::CallbackServerContext* context) override { delete context; }
  void Release(grpc::GenericCallbackServerContext* context) override { delete context; }
};

/// That of a call, made by RecordedContexts.
[[nodiscard]] inline const CallRecordPtr& record_of(const grpc::CallbackServerContext& context) {
  return static_cast<const RecordedContext&>(context).record;
}

}  // namespace heliograph::server
