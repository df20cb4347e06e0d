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

/// Whether durable scenes take edits; unknown to the health service where there can be none.
inline constexpr const char* kDurableName = "heliograph.v1.Durable";

/// Owns: gRPC's server and its threads. Thread: the loop's.
class GrpcServer {
 public:
  using Credentials = std::shared_ptr<grpc::ServerCredentials>;

  /// `tcp`: what connections over TCP pass first. INTERNAL when gRPC does not start.
  [[nodiscard]] static Expected<std::unique_ptr<GrpcServer>> start(Service& service, Daemon& daemon,
                                                                   const Credentials& tcp);
  ~GrpcServer();

  void serve_local(UniqueFd connection) { serve(*local_, std::move(connection)); }
  void serve_tcp(UniqueFd connection) { serve(*tcp_, std::move(connection)); }
  /// What the health service says of "heliograph.v1.Renderer" and of "". Thread: any.
  void set_ready(bool is_ready);
  void set_live(bool is_live);
  /// Ends the calls that are left after `grace`.
  void shutdown(std::chrono::milliseconds grace);

 private:
  using Acceptor = grpc::experimental::ExternalConnectionAcceptor;

  GrpcServer() = default;
  static void serve(Acceptor& acceptor, UniqueFd connection);

  std::unique_ptr<Reflection> reflection_;
  // The acceptors must outlive the server.
  std::unique_ptr<Acceptor> local_;
  std::unique_ptr<Acceptor> tcp_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace heliograph::server
