// The calls of a recording: what came, what went, in the order in which gRPC passes it.
#pragma once

#include <grpcpp/support/server_interceptor.h>

#include "server/observe/recorder.h"

namespace heliograph::server {

/// gRPC asks it at the start of each call. Must come before other interceptors that look at
/// messages. Thread: any. The recorder outlives the server.
class RecordCalls final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  explicit RecordCalls(Recorder& recorder) : recorder_(recorder) {}
  grpc::experimental::Interceptor* CreateServerInterceptor(
      grpc::experimental::ServerRpcInfo* info) override;

 private:
  Recorder& recorder_;
};

}  // namespace heliograph::server
