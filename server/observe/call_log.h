// What every call leaves behind, whatever its service: a request id, a line in the log, metrics.
#pragma once

#include <grpcpp/support/server_interceptor.h>

#include <functional>

#include "server/observe/call_record.h"
#include "server/observe/metrics.h"
#include "server/os/log.h"

namespace heliograph::server {

/// A name for a call that came without one. Unique in this process; another process counts from
/// another start.
[[nodiscard]] std::string new_request_id();

/// How a call ended.
struct CallOutcome {
  int code = 0;            // gRPC's
  std::string reason{};    // of an error, also where the client is not told it
  bool is_hidden = false;  // it is not
};

/// Writes the line of each call: one that ended well, or was cancelled, at level debug; one that
/// was refused at info; a slow one at warning, with where its time went; an error of the daemon's
/// own at error, with what the client is not told. Thread: any. The log and the metrics outlive it.
class CallLog {
 public:
  struct Options {
    double slow_seconds = 0;         // of Pace::kShort
    double slow_render_seconds = 0;  // of Pace::kRender, and of a job of a longer call
    /// The name of a scene that a session sees; "": it has none. Asked when a line is written.
    std::function<std::string(u64 scene, u64 session)> scene_name;
  };
  CallLog(const Log& log, Metrics& metrics, Options options)
      : log_(log), metrics_(metrics), options_(std::move(options)) {}

  /// A call ended.
  void end(CallFacts facts, const CallOutcome& outcome) const;
  /// A job ended, `seconds` after it was queued. Told of those alone that are slow and whose calls
  /// are not judged.
  void end_job(const CallRecord& call, double seconds, const Spent& spent) const;

 private:
  [[nodiscard]] bool is_slow(Pace pace, double seconds) const;

  const Log& log_;
  Metrics& metrics_;
  const Options options_;
};

/// gRPC asks it at the start of each call, which has a RecordedContext. Thread: any. The log
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
