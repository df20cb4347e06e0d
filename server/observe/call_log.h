// What every call leaves behind, whatever its service: a request id, a line in the log, metrics.
#pragma once

#include <grpcpp/support/server_interceptor.h>

#include "server/observe/metrics.h"
#include "server/os/log.h"

namespace heliograph::server {

/// A name for a call that came without one. Unique in this process; another process counts from
/// another start.
[[nodiscard]] std::string new_request_id();

/// The end of a call, and what its client was not told of an error of the daemon's own; null:
/// nothing.
void note_call(const Log& log, Metrics& metrics, std::string_view request,
               const Metrics::CallEnd& end, const std::string* hidden);

/// gRPC asks it at the start of each call. Thread: any. The log and the metrics outlive the server.
///
/// A call that ended well, or was cancelled, is logged at level debug; one that was refused at
/// info; an error of the daemon's own at error, with what the client is not told.
class CallLog final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  CallLog(const Log& log, Metrics& metrics) : log_(log), metrics_(metrics) {}
  grpc::experimental::Interceptor* CreateServerInterceptor(
      grpc::experimental::ServerRpcInfo* info) override;

 private:
  const Log& log_;
  Metrics& metrics_;
};

}  // namespace heliograph::server
