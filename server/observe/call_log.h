// Log line, metrics and request id of every call, of any service.
#pragma once

#include <grpcpp/support/server_interceptor.h>

#include <functional>

#include "server/observe/call_record.h"
#include "server/observe/metrics.h"
#include "server/os/log.h"

namespace heliograph::server {

/// Returns a request id, unique in this process; other processes start from another number.
[[nodiscard]] std::string new_request_id();

/// Outcome of a call.
struct CallOutcome {
  int code = 0;            // gRPC status code
  std::string reason{};    // of an error, including one hidden from the client
  bool is_hidden = false;  // the client gets a general message instead
};

/// Writes a line per call: successful and cancelled ones at level debug, refused ones at info, slow
/// ones at warning with their times, internal errors at error with the reason hidden from the
/// client. Thread: any. The log and the metrics outlive it.
class CallLog {
 public:
  struct Options {
    double slow_seconds = 0;         // for Pace::kShort
    double slow_render_seconds = 0;  // for Pace::kRender, and for each job of a Pace::kClient call
    /// Returns the name of a scene that a session sees; "": it has none. Called when a line is
    /// written.
    std::function<std::string(u64 scene, u64 session)> scene_name;
  };
  CallLog(const Log& log, Metrics& metrics, Options options)
      : log_(log), metrics_(metrics), options_(std::move(options)) {}

  /// Logs the end of a call.
  void end(CallFacts facts, const CallOutcome& outcome) const;
  /// Logs a slow job of a Pace::kClient call, done `seconds` after it was queued.
  void end_job(const CallRecord& call, double seconds, const Spent& spent) const;

 private:
  [[nodiscard]] bool is_slow(Pace pace, double seconds) const;

  const Log& log_;
  Metrics& metrics_;
  const Options options_;
};

/// Creates an interceptor for each call, whose context is a RecordedContext. Thread: any. The log
/// outlives the server.
class ObserveCalls final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  explicit ObserveCalls(const CallLog& log) : log_(log) {}
  grpc::experimental::Interceptor* CreateServerInterceptor(
      grpc::experimental::ServerRpcInfo* info) override;

 private:
  const CallLog& log_;
};

}  // namespace heliograph::server
