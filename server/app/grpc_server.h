// The gRPC server without a listener of its own: connections come from our accept loop.
#pragma once

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <memory>

#include "server/app/reflection.h"
#include "server/calls/service.h"
#include "server/config/config.h"
#include "server/os/accept.h"

namespace heliograph::server {

/// The name under which the health service tells readiness; "" is liveness.
inline constexpr const char* kRendererName = "heliograph.v1.Renderer";

/// Whether durable scenes take edits; unknown to the health service where there can be none.
inline constexpr const char* kDurableName = "heliograph.v1.Durable";

/// Owns: a server of gRPC and its threads. The Unix socket and TCP have one each, because what may
/// be buffered is a server's: whoever fills the one of TCP ends no connection of the other.
/// Thread: the loop's, but where it says more.
class GrpcServer {
 public:
  /// What connections over TCP pass first: null of TLS, without it.
  using Credentials = std::shared_ptr<grpc::ServerCredentials>;

  /// INTERNAL when gRPC does not start.
  [[nodiscard]] static Expected<std::unique_ptr<GrpcServer>> start_local(Daemon& daemon);
  [[nodiscard]] static Expected<std::unique_ptr<GrpcServer>> start_tcp(Daemon& daemon,
                                                                       Credentials tls);
  ~GrpcServer();

  void serve(UniqueFd connection);
  /// What the health service says of "heliograph.v1.Renderer", of "", and of
  /// "heliograph.v1.Durable". Thread: any.
  void set_ready(bool is_ready);
  void set_live(bool is_live);
  void set_durable(bool is_writing);
  /// Ends the calls that are left after `grace`.
  void shutdown(std::chrono::milliseconds grace);

 private:
  using Acceptor = grpc::experimental::ExternalConnectionAcceptor;

  explicit GrpcServer(Daemon& daemon) : service_(daemon) {}
  [[nodiscard]] Status build(grpc::ServerBuilder& builder, Daemon& daemon, u64 quota_bytes);
  void set(const char* name, bool is_serving);

  Service service_;
  std::unique_ptr<Reflection> reflection_;
  // The acceptors must outlive the server.
  std::unique_ptr<Acceptor> acceptor_;
  std::unique_ptr<Acceptor> exposed_;  // TCP without TLS at an address that others reach
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace heliograph::server
