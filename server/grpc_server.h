// The gRPC server without a listener of its own: connections come from our accept loop.
#pragma once

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <memory>

#include "server/accept.h"
#include "server/config.h"
#include "server/reflection.h"
#include "server/service.h"

namespace heliograph::server {

/// The name under which the health service tells readiness; "" is liveness.
inline constexpr const char* kRendererName = "heliograph.v1.Renderer";

/// Owns: gRPC's server and its threads. Thread: the loop's.
class GrpcServer {
 public:
  /// INTERNAL when gRPC does not start.
  [[nodiscard]] static Expected<std::unique_ptr<GrpcServer>> start(Service& service,
                                                                   Daemon& daemon);

  void serve(UniqueFd connection);
  /// What the health service says of "heliograph.v1.Renderer"; "" stays SERVING.
  void set_ready(bool is_ready);
  /// Ends the calls that are left after `grace`.
  void shutdown(std::chrono::milliseconds grace);

 private:
  GrpcServer() = default;
  std::unique_ptr<Reflection> reflection_;
  // The acceptor must outlive the server.
  std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> acceptor_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace heliograph::server
