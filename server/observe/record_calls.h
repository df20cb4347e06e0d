// Records calls: their messages, in the order in which gRPC passes them.
#pragma once

#include <grpcpp/support/server_interceptor.h>

#include "server/observe/recorder.h"

namespace heliograph::server {

/// Creates an interceptor for each call. Must come before other interceptors that read messages.
/// Thread: any. The recorder outlives the server.
class RecordCalls final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  explicit RecordCalls(Recorder& recorder) : recorder_(recorder) {}
  grpc::experimental::Interceptor* CreateServerInterceptor(
      grpc::experimental::ServerRpcInfo* info) override;

 private:
  Recorder& recorder_;
};

}  // namespace heliograph::server
