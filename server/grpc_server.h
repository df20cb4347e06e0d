// The gRPC server without a listener of its own: connections come from our accept loop.
#pragma once

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <memory>

#include "server/accept.h"
#include "server/config.h"
#include "server/service.h"

namespace heliograph::server {

/// Owns: gRPC's server and its threads. Thread: the loop's.
class GrpcServer {
 public:
  /// INTERNAL when gRPC does not start.
  [[nodiscard]] static Expected<std::unique_ptr<GrpcServer>> start(Service& service,
                                                                   const Config& config);

  void serve(UniqueFd connection);
  /// What the health service says of "heliograph.v1.Renderer"; "" stays SERVING.
  void set_ready(bool is_ready);
  /// Ends the calls that are left after `grace`.
  void shutdown(std::chrono::milliseconds grace);

 private:
  GrpcServer() = default;
  // The acceptor must outlive the server.
  std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> acceptor_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace heliograph::server
