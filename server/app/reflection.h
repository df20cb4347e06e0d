// Server reflection: sends the protocol's descriptors to admitted callers. Made by grpc_server.cpp
// with --reflection.
#pragma once

#include "server/app/reflection.grpc.pb.h"
#include "server/session/gate.h"

namespace heliograph::server {

/// Describes heliograph.v1 only. Thread: any. (gRPC's own plug-in replies without asking the gate.)
class Reflection final : public grpc::reflection::v1alpha::ServerReflection::CallbackService {
 public:
  using Request = grpc::reflection::v1alpha::ServerReflectionRequest;
  using Response = grpc::reflection::v1alpha::ServerReflectionResponse;

  explicit Reflection(Gate& gate) : gate_(gate) {}
  grpc::ServerBidiReactor<Request, Response>* ServerReflectionInfo(
      grpc::CallbackServerContext* context) override;

 private:
  Gate& gate_;
};

}  // namespace heliograph::server
