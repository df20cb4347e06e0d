// Facts of a running call for its line in the log, gathered by the call log, the gate's callers and
// the render tasks.
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

/// Bounds of a call's duration, and so the limit beyond which it is slow.
enum class Pace {
  kShort,   // slow_call_seconds
  kRender,  // slow_render_seconds: it waits for the device, or for a decoder
  kClient,  // no limit: it lasts as long as its client wants, or moves the client's bytes
};

/// Sums over the jobs of a call, consecutive or concurrent.
struct CallJobs {
  u32 count = 0;
  CallClock::time_point first, last;  // the first one queued, the last one done
  double waited_seconds = 0;          // from queued until on a device
  double aside_seconds = 0;           // derived data, and planes computed from others
  double device_seconds = 0;
};

/// Method of an unknown call. Its caller's name for it ends before the call does, and would make a
/// metrics series per name.
constexpr std::string_view kUnknownMethod = "/unknown";

struct CallFacts {
  std::string_view method;  // "/heliograph.v1.Renderer/Apply", kUnknownMethod; outlives the call
  CallClock::time_point start;
  std::string request;  // request id
  Trace trace;
  std::string peer;    // as gRPC names it
  std::string tenant;  // "": not admitted
  std::string client;  // the name that the session's client gave itself
  u64 session = 0;     // 0: none
  u64 scene = 0;       // 0: none
  std::string scene_name;
  Pace pace = Pace::kClient;
  u64 received_bytes = 0, sent_bytes = 0;  // of messages
  CallJobs jobs;
};

/// The record of a call. Thread: any.
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
  /// Changes the facts under the lock.
  template <class Change>
  void note(const Change& change) {
    const std::lock_guard lock(mutex_);
    change(facts_);
  }
  /// Records that a job was queued.
  void begin_job() {
    const std::lock_guard lock(mutex_);
    const auto now = CallClock::now();
    if (facts_.jobs.count++ == 0) facts_.jobs.first = facts_.jobs.last = now;
  }
  /// Records that a job is done.
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

/// A call's context with its record, which is written to the log after the context is freed.
class RecordedContext final : public grpc::CallbackServerContext {
 public:
  const CallRecordPtr record = std::make_shared<CallRecord>();
};

/// Allocates the contexts of calls for gRPC. Unknown methods have no record, but are allocated here
/// too: gRPC 1.51 frees a context twice that it allocates beside an allocator.
class RecordedContexts final : public grpc::ContextAllocator {
 public:
  grpc::CallbackServerContext* NewCallbackServerContext() override { return new RecordedContext; }
  grpc::GenericCallbackServerContext* NewGenericCallbackServerContext() override {
    return new grpc::GenericCallbackServerContext;
  }
  void Release(grpc::CallbackServerContext* context) override { delete context; }
  void Release(grpc::GenericCallbackServerContext* context) override { delete context; }
};

/// Returns the record of a call whose context RecordedContexts made.
[[nodiscard]] inline const CallRecordPtr& record_of(const grpc::CallbackServerContext& context) {
  return static_cast<const RecordedContext&>(context).record;
}

}  // namespace heliograph::server
